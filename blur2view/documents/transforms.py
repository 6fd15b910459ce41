"""The names of the dialects of ``transforms.json``."""

INSTANT_NGP, NERFSTUDIO = DIALECTS = ("instant-ngp", "nerfstudio")
