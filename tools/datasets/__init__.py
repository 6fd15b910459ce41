"""Rendered test sets and shards, synthetic matches."""
