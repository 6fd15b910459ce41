"""Tests of blur2view.movers."""
