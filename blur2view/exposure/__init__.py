"""The views at shutter-open and shutter-close, and which came first."""
