"""Tests of tools.rendering."""
