"""The smear field, and matches whose order is unknown."""
