"""Network files, and the network that measures smears."""
