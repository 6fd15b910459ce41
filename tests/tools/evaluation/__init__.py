"""Tests of tools.evaluation."""
