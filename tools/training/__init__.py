"""Training and export of both networks."""
