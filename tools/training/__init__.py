"""Training and export of the network."""
