"""Tests of blur2view.results."""
