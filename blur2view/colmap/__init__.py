"""COLMAP databases, models and mapping."""

INSTANT_NGP, NERFSTUDIO = DIALECTS = ("instant-ngp", "nerfstudio")  # the dialects of ``transforms.json``
GSPLAT = "gsplat"  # a trainer that reads COLMAP's models instead
