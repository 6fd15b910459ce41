"""Tests of blur2view.networks."""
