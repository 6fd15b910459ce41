"""COLMAP databases, text formats and mapping."""
