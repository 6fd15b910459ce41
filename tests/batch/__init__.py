"""Tests of blur2view.batch."""
