"""Text for COLMAP's ``matches_importer``; what `blur2view.colmap.text_formats` holds, by its short path."""

from blur2view.colmap.text_formats import keypoints_text, matches_text, write_matches_text

__all__ = ["keypoints_text", "matches_text", "write_matches_text"]
