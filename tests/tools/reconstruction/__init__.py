"""Tests of tools.reconstruction."""
