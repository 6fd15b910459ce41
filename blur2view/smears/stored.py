"""Smears in a file, ``.smear.npz``: the network's own grid in half precision, or every pixel.

A half has eleven bits: a smear's length and direction change by a 4000th at most, a hundredth of what the
network errs by, and a photograph of 20 megapixels takes 0.2 MB, where all its pixels take 320.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.errors import OutputError
from blur2view.input_files import MAX_PIXELS, open_regular
from blur2view.smears.field import SmearField
from blur2view.smears.grid import SmearGrid
from blur2view.smears.noise import WINDOW_PX

GRID, FIELD = "smear_grid", "displacement"  # the first array of either kind of file
BLUR = "blur_grid"
USED = ("ends", "match_sigma_px", "inlier_mask", "swapped")
DAMAGE = (OSError, EOFError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError,
          RuntimeError, MemoryError, zipfile.BadZipFile)  # fmt: skip
"""What the readers of ZIP and NPY raise of damaged bytes; RuntimeError of an archive with a password."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredSmears:
    """The smears of one photograph, and which of them the estimate used.

    Parameters
    ----------
    smears : SmearGrid or SmearField
        On the network's grid, or at every pixel.
    ends : ndarray of shape (N, 2, 2)
        Both ends of the smears that were used, pixels.
    match_sigma_px : ndarray of shape (N,)
        Their standard deviations, as the estimator weighs them.
    inlier_mask : ndarray of bool, shape (N,)
        Whether they fit the geometry.
    swapped : ndarray of bool, shape (N,)
        Whether ``ends[:, 1]`` is the open end.

    Raises
    ------
    ValueError
        If a shape or a type is another.
    """

    smears: SmearGrid | SmearField
    ends: AnyArray
    match_sigma_px: AnyArray
    inlier_mask: AnyArray
    swapped: AnyArray

    def __post_init__(self) -> None:
        count = self.ends.shape[:1]
        shapes = {"ends": (*count, 2, 2), "match_sigma_px": count, "inlier_mask": count, "swapped": count}
        kinds = dict(zip(USED, "ffbb", strict=True))
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape or array.dtype.kind != kinds[name]:
                raise ValueError(f"expected {name} of shape {shape}, got {array.dtype} {array.shape}")

    def at_pixels(self) -> SmearField:
        """Return the smear of every pixel and its standard deviations."""
        return self.smears.at_pixels() if isinstance(self.smears, SmearGrid) else self.smears

    def arrays(self) -> dict[str, AnyArray]:
        """Return the arrays of the file by name, those that say which kind it is first."""
        used = {name: getattr(self, name) for name in USED}
        if isinstance(self.smears, SmearGrid):
            grid = self.smears
            place = {"stride": np.array(grid.stride), "shape": np.array(grid.shape)}
            place["window_px"] = np.array(grid.window_px or 0)
            blur = {} if grid.blur is None else {BLUR: grid.blur.astype(np.float16)}
            return {GRID: grid.cells.astype(np.float16), **blur, **place, **used}
        field = self.smears
        return {FIELD: field.displacement, "sigma_px": field.sigma_px, "sigma_rad": field.sigma_rad, **used}


def load_smears(path: str | Path) -> StoredSmears:
    """Return what ``blur2view estimate -o`` has written to a ``.smear.npz`` file.

    Parameters
    ----------
    path : path-like
        The file, of either kind, with ``--full-field`` or without.

    Returns
    -------
    StoredSmears
        Its ``at_pixels()`` is the smear of every pixel.

    Raises
    ------
    OutputError
        If the file is missing, damaged or something else.
    """
    try:
        with open_regular(path) as file, np.load(file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        return StoredSmears(smears=_smears(arrays), **{name: arrays[name] for name in USED})
    except FileNotFoundError:
        raise OutputError(f"{path}: no such file; write it with blur2view estimate -o") from None
    except DAMAGE:
        remedy = "write it again with blur2view estimate -o"
        raise OutputError(f"{path}: is no whole .smear.npz file of blur2view; {remedy}") from None


def _smears(arrays: dict[str, AnyArray]) -> SmearGrid | SmearField:
    if GRID not in arrays:
        sigmas = {name: arrays[name] for name in ("sigma_px", "sigma_rad")}
        return SmearField(displacement=arrays[FIELD], **sigmas)
    height, width = map(int, arrays["shape"])
    cells = arrays[GRID].astype(np.float32)
    blur = arrays[BLUR].astype(np.float32) if BLUR in arrays else None
    finite = np.isfinite(cells).all() and (blur is None or np.isfinite(blur).all())
    if not finite or height * width > MAX_PIXELS:
        raise ValueError("a smear grid must be finite, and of a photograph")
    window_px = int(arrays.get("window_px", WINDOW_PX))
    return SmearGrid(
        cells=cells,
        blur=blur,
        stride=int(arrays["stride"]),
        shape=(height, width),
        window_px=window_px or None,
    )
