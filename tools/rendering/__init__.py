"""Motion-blurred pictures with exact smears, from one integer seed."""
