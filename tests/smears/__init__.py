"""Tests of blur2view.smears."""
