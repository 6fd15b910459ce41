"""Views placed in a finished model; what `blur2view.colmap.placement` holds, by its short path."""

from blur2view.colmap.placement import Placement, place_views

__all__ = ["Placement", "place_views"]
