"""Tests of blur2view.runs."""
