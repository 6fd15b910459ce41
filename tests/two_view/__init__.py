"""Tests of blur2view.two_view."""
