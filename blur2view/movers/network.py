"""The network that finds what moves by itself: a U-Net, ``models/movers.onnx``, run by ONNX Runtime.

Its inputs are those of :mod:`blur2view.movers.inputs`; ``tools/training/train_movers.py`` trains it.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blur2view.errors import ModelError
from blur2view.networks.model_file import Execution, OnnxNetwork, shipped_file

Floats = NDArray[np.float32]

SHIPPED = "movers.onnx"
REMEDY = "install blur2view again, or export one with tools/training/export_movers.py"
INPUTS, OUTPUT = ("places", "cells"), "log_odds"
"""Of float32: places (1, 15, 8 h, 8 w), cells (1, 19, h, w) and log_odds (1, 2, 8 h, 8 w)."""
CELL_PX = 32
"""Side of the cells that it was trained on."""


class MoverNetwork:
    """The loaded network.

    Parameters
    ----------
    path : Path, optional
        An ONNX file written by ``tools/training/export_movers.py``; the shipped one by default.
    execution : Execution, optional
        What runs it.

    Raises
    ------
    ModelError
        If the file is missing, not ONNX, or has other inputs.
    """

    def __init__(self, path: Path | None = None, execution: Execution | None = None) -> None:
        self._network = OnnxNetwork(path or shipped_file(SHIPPED), execution or Execution(), REMEDY)
        if [node.name for node in self._network.session.get_inputs()] != list(INPUTS):
            raise ModelError(f"{self._network.path}: is not a mover network; {REMEDY}")

    def log_odds(self, places: Floats, cells: Floats) -> tuple[Floats, Floats]:
        """Return the log-odds (8 h, 8 w) that places move, and that their smears are read right.

        Parameters
        ----------
        places : ndarray of shape (8 h, 8 w, 15)
        cells : ndarray of shape (h, w, 19)

        Raises
        ------
        ModelError
            If the network cannot be run on them.
        """
        height, width = (CELL_PX * side for side in cells.shape[:2])
        inputs = (np.ascontiguousarray(np.moveaxis(each, -1, 0)[None]) for each in (places, cells))
        (found,) = self._network.run(dict(zip(INPUTS, inputs, strict=True)), (width, height))
        moving, read = found[0]
        return moving, read


@cache
def shipped(execution: Execution) -> MoverNetwork:
    """Return the network that ships."""
    return MoverNetwork(execution=execution)
