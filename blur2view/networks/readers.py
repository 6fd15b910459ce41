"""What a network's file computes on one tile of a photograph: a grid of smears and standard deviations."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.errors import ModelError
from blur2view.networks.comb import STEP, put_on_comb
from blur2view.networks.model_file import REMEDY, ModelInfo, session_errors
from blur2view.networks.octaves import doubled, joined, octaves
from blur2view.smears.likelihood import BINS, DIRECTIONS, read_smears

Floats = NDArray[np.float32]

LEAST_PX = 64
"""Least side of the smallest octave: two cells, more than its mirrored border."""


class TileReader(Protocol):
    """A network that reads tiles; cell j of its grid is centred at pixel stride * j + (stride - 1) / 2."""

    stride: int

    def multiple_of(self, levels: int) -> int:
        """Return what height and width of a tile must be multiples of where `levels` octaves are read."""

    def read(self, tile: Floats, levels: int) -> Floats:
        """Return double angle and standard deviations (H / stride, W / stride, C) of a tile (H, W, 3)."""


def reader_of(path: Path, session: Any, info: ModelInfo) -> TileReader:
    """Return the reader of a network's format."""
    return SmearReader(path, session, info) if info.format == "1" else LikelihoodReader(path, session, info)


class SmearReader:
    """A network that gives smears by itself (format 1); it looks at the picture's own size only."""

    def __init__(self, path: Path, session: Any, info: ModelInfo) -> None:
        self.path, self.session, self.info = path, session, info
        self.stride = info.stride

    def multiple_of(self, levels: int) -> int:
        """Return the network's own multiple."""
        return self.info.multiple_of

    def read(self, tile: Floats, levels: int) -> Floats:
        """Run the network."""
        planes = np.ascontiguousarray(tile.transpose(2, 0, 1)[None])
        (smears,) = run(self.path, self.session, {"image": planes}, tile.shape)
        size = tuple(side // self.stride for side in tile.shape[:2])
        check_shape(self.path, smears, (1, self.info.channels, *size))
        grid: Floats = smears[0].transpose(1, 2, 0)
        return grid


class LikelihoodReader:
    """A network that reads the likelihood of smears in one octave, given the smaller one (format 2)."""

    def __init__(self, path: Path, session: Any, info: ModelInfo) -> None:
        self.path, self.session, self.info = path, session, info
        self.stride = info.stride
        self.channels = session.get_inputs()[1].shape[4]
        self.threads = session.get_session_options().intra_op_num_threads
        if not isinstance(self.channels, int):
            raise ModelError(f"{path}: does not fix the number of its features; {REMEDY}")
        if info.stride != STEP:
            raise ModelError(f"{path}: reads windows {info.stride} px apart instead of {STEP}; {REMEDY}")

    def multiple_of(self, levels: int) -> int:
        """Return a whole number of windows' steps in the smallest octave."""
        return self.info.multiple_of << levels - 1

    def read(self, tile: Floats, levels: int) -> Floats:
        """Read all octaves, the smallest first, join their logits, read smears off them and the combs."""
        grey = np.asarray(cv2.cvtColor(np.ascontiguousarray(tile), cv2.COLOR_RGB2GRAY), np.float32)
        pictures = octaves(grey, levels)
        smallest, *larger = reversed(pictures)
        joint, features = self.read_octave(smallest, None)
        for level in larger:
            logits, features = self.read_octave(level, features)
            joint = joined(logits, doubled(joint, logits.shape[:2]))
        return put_on_comb(read_smears(joint), pictures, self.threads)

    def read_octave(self, grey: Floats, coarser: Floats | None) -> tuple[Floats, Floats]:
        """Return logits (h, w, 32, B) and features (h, w, 32, C) of an octave, given those of the smaller."""
        size = (grey.shape[0] // self.info.stride, grey.shape[1] // self.info.stride)
        shape = (*size, DIRECTIONS, self.channels)
        above = np.zeros(shape, np.float32) if coarser is None else doubled(coarser, size)
        inputs = {"grey": grey[None, None], "coarser": above[None]}
        logits, features = run(self.path, self.session, inputs, grey.shape)
        check_shape(self.path, features, (1, *shape))
        check_shape(self.path, logits, (1, *size, DIRECTIONS, BINS))
        if not np.isfinite(logits).all():
            raise ModelError(f"{self.path}: gives values that are not finite; {REMEDY}")
        return logits[0], features[0]


def run(path: Path, session: Any, inputs: dict[str, Floats], shape: tuple[int, ...]) -> list[Floats]:
    """Return the network's outputs; ModelError if it cannot be run on a picture of this shape (H, W, ...)."""
    try:
        outputs: list[Floats] = session.run(None, inputs)
    except session_errors():
        raise ModelError(f"{path}: cannot be run on {shape[1]}x{shape[0]} pixels; {REMEDY}") from None
    return outputs


def check_shape(path: Path, output: Floats, expected: tuple[int, ...]) -> None:
    """Raise ModelError unless a network's output has the shape that its stride promises."""
    if output.shape != expected:
        raise ModelError(
            f"{path}: gives shape {output.shape} where its stride promises {expected}; "
            "export it again with tools/training/export_reader.py"
        )
