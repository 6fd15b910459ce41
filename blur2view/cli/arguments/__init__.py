"""What the user may ask of each command, and what it does: one file each, that imports late."""
