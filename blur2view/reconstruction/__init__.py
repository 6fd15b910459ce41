"""From a video to a scene: frames are chosen, COLMAP maps them, and what it refuses is recovered."""
