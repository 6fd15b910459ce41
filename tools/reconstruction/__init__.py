"""Videos and structure from motion with the views of exposures."""
