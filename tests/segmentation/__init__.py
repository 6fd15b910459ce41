"""Tests of blur2view.segmentation."""
