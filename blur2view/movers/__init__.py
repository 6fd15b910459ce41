"""Motion masks: which pixels of a photograph move by themselves."""
