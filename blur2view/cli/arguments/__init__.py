"""What the user may ask of each command: options and ``--help``, built without importing what takes time."""
