"""Tests of tools.estimators."""
