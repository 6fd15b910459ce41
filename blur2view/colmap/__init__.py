"""COLMAP databases, models and mapping."""
