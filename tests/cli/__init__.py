"""Tests of blur2view.cli."""
