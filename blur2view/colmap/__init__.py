"""COLMAP databases, text formats and mapping."""

INSTANT_NGP, NERFSTUDIO = DIALECTS = ("instant-ngp", "nerfstudio")
"""The dialects of ``transforms.json``."""
