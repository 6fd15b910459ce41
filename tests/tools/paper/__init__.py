"""Tests of tools.paper."""
