"""Tests of blur2view.colmap."""
