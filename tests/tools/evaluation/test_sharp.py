"""What counts as sure of a smear: long enough, and known."""

import numpy as np

from blur2view.smears.grid import SmearGrid
from tools.evaluation.sharp import Reading, sure_share, table


def test_only_long_and_known_smears_count() -> None:
    cells = np.zeros((1, 4, 4), np.float32)
    cells[0, :, 0] = -8, 8, 1, 0
    cells[0, :, 2] = 1, 6, 0.1, 0.1
    assert sure_share(SmearGrid(cells=cells, stride=32, shape=(32, 128))) == 0.25


def test_the_worst_photograph_comes_first() -> None:
    rows = [
        Reading(name="wall", verdict="DEGENERATE: no motion", length_px=0.3, sure_share=0.0),
        Reading(name="sky", verdict="PLANAR: it moves", length_px=6.0, sure_share=0.5),
    ]
    lines = table(rows).splitlines()
    assert lines[0].startswith("1 of 2 without motion; 25.00%") and lines[4].startswith("| sky")
