"""Robust estimation: the loop, minimal solvers, parametrizations, refinement."""
