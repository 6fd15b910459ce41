"""The two networks that find what moves by itself: by what it looks like, and by how it is blurred.

``models/unet.onnx`` sees the photograph in squares of 4 x 4 pixels and what the smear network says of its
cells; it also says whether the camera moved. ``models/movers.onnx`` sees blur against the camera's motion
(:mod:`blur2view.movers.blur_evidence`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blur2view.errors import ModelError
from blur2view.networks.model_file import Execution, OnnxNetwork, metadata_of, shipped_file
from blur2view.networks.octave_reader import LENGTHS
from blur2view.networks.spectra import STEP
from blur2view.smears.blur_kinds import IN_FOCUS_PX, KINDS
from blur2view.smears.grid import SmearGrid
from blur2view.smears.likelihood import DIRECTIONS

Floats = NDArray[np.float32]

PLACE_PX = 4
"""Side of the places that both answer for, pixels."""
CELL_VALUES = DIRECTIONS + LENGTHS + len(KINDS) + 1
"""Square roots of the shares of directions and of lengths, kinds of blur, logarithm of the radius."""
REMEDY = "install blur2view again"


@dataclass(frozen=True, kw_only=True)
class NetworkFormat:
    """A file of ``models/``, what it says of itself, and the names of its inputs and outputs."""

    file: str
    version: str
    inputs: tuple[str, str]
    outputs: tuple[str, ...]


UNET = NetworkFormat(
    file="unet.onnx", version="unet-1", inputs=("image", "cells"), outputs=("log_odds", "camera_moved")
)
"""Of float32: image (1, 3, 32 h, 32 w), cells (1, 70, h, w), log_odds (1, 8 h, 8 w), camera_moved (1,)."""
BLUR = NetworkFormat(
    file="movers.onnx", version="movers-1", inputs=("places", "cells"), outputs=("log_odds",)
)
"""Of float32: places (1, 15, 8 h, 8 w), cells (1, 19, h, w), log_odds (1, 2, 8 h, 8 w)."""


class MoverNetwork:
    """A loaded network of either format.

    Parameters
    ----------
    form : NetworkFormat
    path : Path, optional
        An ONNX file of this format; the shipped one by default.
    execution : Execution, optional
        What runs it.

    Raises
    ------
    ModelError
        If the file is missing, not ONNX, or of another format.
    """

    def __init__(
        self, form: NetworkFormat, path: Path | None = None, execution: Execution | None = None
    ) -> None:
        self.form = form
        self._network = OnnxNetwork(path or shipped_file(form.file), execution or Execution(), REMEDY)
        self.model_id = metadata_of(self._network, "a mover network", form.version)["model_id"]

    def __call__(self, fine: Floats, cells: Floats) -> list[Floats]:
        """Return the outputs for one photograph, without the first axis.

        Parameters
        ----------
        fine : ndarray of shape (H, W, C)
            The photograph, or what is known of its places.
        cells : ndarray of shape (h, w, D)

        Raises
        ------
        ModelError
            If the network cannot be run on them, or what it gives is not finite.
        """
        inputs = (np.ascontiguousarray(np.moveaxis(each, -1, 0)[None]) for each in (fine, cells))
        size = STEP * cells.shape[1], STEP * cells.shape[0]
        outputs = self._network.run(dict(zip(self.form.inputs, inputs, strict=True)), size)
        if not all(np.isfinite(output).all() for output in outputs):
            raise ModelError(f"{self._network.path}: gives values that are not finite; {REMEDY}")
        return [output[0] for output in outputs]


@cache
def shipped(form: NetworkFormat, execution: Execution) -> MoverNetwork:
    """Return the network of a format that ships."""
    return MoverNetwork(form, execution=execution)


def cell_values(grid: SmearGrid) -> Floats:
    """Return what the smear network says of the cells of a grid, (h, w, 70), as the U-Net sees it.

    Raises
    ------
    ValueError
        If the grid was not read from a photograph, or its cells have other than `STEP` pixels.
    """
    if grid.shares is None or grid.blur is None or grid.stride != STEP:
        raise ValueError("expected smears as SmearNetwork reads them off a photograph")
    radius = np.log(np.maximum(grid.blur[..., :1], IN_FOCUS_PX))  # 0 where nothing is seen
    return np.concatenate([np.sqrt(grid.shares), grid.blur[..., 1:], radius], axis=-1).astype(np.float32)
