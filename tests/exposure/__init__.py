"""Tests of blur2view.exposure."""
