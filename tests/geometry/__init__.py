"""Tests of blur2view.geometry."""
