"""Figures of merit: of smears, F, poses, masks, and time."""
