"""COLMAP databases, models and mapping."""

INSTANT_NGP, NERFSTUDIO = DIALECTS = ("instant-ngp", "nerfstudio")
"""The dialects of ``transforms.json``."""
GSPLAT = "gsplat"
"""A trainer that reads COLMAP's models instead."""
