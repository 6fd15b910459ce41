"""Formulas of two views, without any search."""
