"""Damage done to COLMAP databases, to see that nothing of the user's is lost."""
