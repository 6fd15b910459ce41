"""Tests of tools.reports."""
