"""Tests of blur2view.images."""
