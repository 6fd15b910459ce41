"""Tests of blur2view.photographs."""
