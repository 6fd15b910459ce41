"""The evidence for what moves by itself, and the two networks that weigh it."""
