"""Tests of tools.robustness."""
