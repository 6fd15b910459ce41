"""Rendered test sets, synthetic matches."""
