"""Tests of blur2view.reconstruction."""
