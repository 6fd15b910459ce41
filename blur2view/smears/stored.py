"""Smears in a file, ``.smear.npz``: the network's own grid in half precision.

A half has eleven bits: a smear's length and direction change by a 4000th at most, a hundredth of what the
network errs by, and a photograph of 20 megapixels takes 0.2 MB, where all its pixels take 320.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.errors import OutputError
from blur2view.input_files import MAX_PIXELS, open_regular
from blur2view.smears.grid import SmearGrid
from blur2view.smears.noise import WINDOW_PX

GRID, BLUR = "smear_grid", "blur_grid"
MOST_BYTES = 1 << 26  # of an array; a grid's has some millions
DAMAGE = (OSError, EOFError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError,
          RuntimeError, MemoryError, zipfile.BadZipFile)  # fmt: skip
"""What the readers of ZIP and NPY raise of damaged bytes; RuntimeError of an archive with a password."""


def stored_smears(grid: SmearGrid) -> dict[str, AnyArray]:
    """Return the arrays of a file by name."""
    place = {"stride": grid.stride, "shape": grid.shape, "window_px": grid.window_px or 0}
    blur = {} if grid.blur is None else {BLUR: grid.blur.astype(np.float16)}
    named = {name: np.array(value) for name, value in place.items()}
    return {GRID: grid.cells.astype(np.float16), **blur, **named}


def load_smears(path: str | Path) -> SmearGrid:
    """Return the smears that ``blur2view estimate -o`` has written to a ``.smear.npz`` file.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    SmearGrid
        As `SmearNetwork.predict` returns it, with ``at(points)`` and ``at_pixels()``.

    Raises
    ------
    OutputError
        If the file is missing, damaged or something else.
    """
    try:
        with open_regular(path) as file, np.load(file, allow_pickle=False) as stored:
            return _grid(dict(_arrays(stored)))
    except FileNotFoundError:
        raise OutputError(f"{path}: no such file; write it with blur2view estimate -o") from None
    except DAMAGE:
        remedy = "write it again with blur2view estimate -o"
        raise OutputError(f"{path}: is no whole .smear.npz file of blur2view; {remedy}") from None


def _arrays(stored: Any) -> Iterator[tuple[str, AnyArray]]:
    """Yield the arrays of an open file by name; ValueError of one that is larger than any grid's.

    `numpy.savez` compresses nothing: what unfolds to more than the file has is refused before it does.
    """
    for member in stored.zip.infolist():
        if member.compress_type != zipfile.ZIP_STORED or member.file_size > MOST_BYTES:
            raise ValueError(f"{member.filename} is compressed or too large")
        name = member.filename.removesuffix(".npy")
        yield name, stored[name]


def _grid(arrays: dict[str, AnyArray]) -> SmearGrid:
    cells, (height, width) = arrays[GRID].astype(np.float32), map(int, arrays["shape"])
    stride, window_px = int(arrays["stride"]), int(arrays.get("window_px", WINDOW_PX))
    blur = arrays[BLUR].astype(np.float32) if BLUR in arrays else None
    if not (np.isfinite(cells).all() and (blur is None or np.isfinite(blur).all())):
        raise ValueError("smears must be finite")
    if height * width > MAX_PIXELS:
        raise ValueError("a grid must be of a photograph")
    return SmearGrid(
        cells=cells, blur=blur, stride=stride, shape=(height, width), window_px=window_px or None
    )
