"""Damage done to inputs, databases and our own code, to see what notices it."""
