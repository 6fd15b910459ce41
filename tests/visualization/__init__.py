"""Tests of blur2view.visualization."""
