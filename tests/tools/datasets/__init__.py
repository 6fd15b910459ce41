"""Tests of tools.datasets."""
