"""What ``blur2view to-colmap`` makes of photographs, and where it writes it."""
