"""The tests of blur2view and of its tools; folders are those of what they test."""
