"""The evidence for what moves by itself, and the network that weighs it."""
