"""Tests of blur2view.robust."""
