"""Photographs and the cameras that took them."""
