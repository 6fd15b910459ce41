"""Tests of blur2view.camera."""
