"""The network that finds what moves by itself: a U-Net, ``models/movers.onnx``, run by ONNX Runtime.

Its inputs are those of :mod:`blur2view.movers.inputs`; ``tools/training/train_movers.py`` trains it.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blur2view.errors import ModelError
from blur2view.networks.model_file import open_session, patient, session_errors, shipped_file, usable_cores

Floats = NDArray[np.float32]

SHIPPED = "movers.onnx"
REMEDY = "install blur2view again, or export one with tools/training/export_movers.py"
INPUTS, OUTPUT = ("places", "cells"), "log_odds"
"""Of float32: places (1, 15, 8 h, 8 w), cells (1, 19, h, w) and log_odds (1, 2, 8 h, 8 w)."""


class MoverNetwork:
    """The loaded network.

    Parameters
    ----------
    path : Path, optional
        An ONNX file written by ``tools/training/export_movers.py``; the shipped one by default.

    Raises
    ------
    ModelError
        If the file is missing, not ONNX, or has other inputs.
    """

    def __init__(self, path: Path | None = None) -> None:
        self.path = shipped_file(SHIPPED) if path is None else path
        self._session = open_session(self.path, usable_cores(), remedy=REMEDY)
        names = tuple(node.name for node in self._session.get_inputs())
        if names != INPUTS:
            raise ModelError(f"{self.path}: is not a mover network; {REMEDY}")

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
        inputs = (np.ascontiguousarray(np.moveaxis(each, -1, 0)[None]) for each in (places, cells))
        try:
            with patient(cells.shape[0] * cells.shape[1]) as options:
                (found,) = self._session.run([OUTPUT], dict(zip(INPUTS, inputs, strict=True)), options)
        except session_errors() as error:
            raise ModelError(f"{self.path}: cannot be run ({error})") from None
        moving, read = found[0]
        return moving, read


@cache
def shipped() -> MoverNetwork:
    """Return the network that ships."""
    return MoverNetwork()
