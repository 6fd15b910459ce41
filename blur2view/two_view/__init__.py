"""Policy: which model the smears support, and whether to believe it."""
