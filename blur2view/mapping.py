"""Reconstruction with the views of exposures; what `blur2view.colmap.mapping` holds, by its short path."""

from blur2view.colmap.mapping import global_options, mapper_options, triangulate_exposure

__all__ = ["global_options", "mapper_options", "triangulate_exposure"]
