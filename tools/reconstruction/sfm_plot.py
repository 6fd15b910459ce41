"""The picture of the videos' reconstructions: rotation during every exposure, found and true, over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tools.reconstruction.sfm_result import Result

SHOWN = {"true": ("0.2", 2.5), "views placed": ("C2", 1.4), "views mapped": ("C0", 0.8)} | {
    "single photographs": ("C1", 0.8)
}
"""What is drawn: colour, width of the line."""


def plot(results: Sequence[Result], path: Path) -> None:
    """Draw the three components of the rotation vectors, a row for each recording, degrees."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(15, 3.2 * len(results)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(results), 3, squeeze=False)
    for row, result in zip(panels, results, strict=True):
        placed = result.motion_of(result.placed)
        motions = (result.true_motion, placed, result.motion, result.estimated)
        for axis, panel in enumerate(row):
            for (name, (colour, width)), motion in zip(SHOWN.items(), motions, strict=True):
                rotations = np.degrees(motion.rotations[:, axis])
                panel.plot(rotations, ".-", color=colour, linewidth=width, markersize=4, label=name)
            limit = 1.3 * float(np.degrees(np.abs(result.true_motion.rotations).max()))
            if np.isfinite(limit):
                panel.set_ylim(-limit, limit)
            panel.set_xlabel(f"{result.recording.name}, {result.model_id}: frame")
            panel.grid(alpha=0.3)
        row[0].set_ylabel("rotation, degrees")
    for panel, letter in zip(panels[0], "xyz", strict=True):
        panel.set_title(f"about {letter}")
    panels[0][0].legend()
    figure.savefig(path, dpi=70)
