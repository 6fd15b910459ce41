"""Tests of tools.benchmarks."""
