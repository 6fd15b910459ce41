"""Smear grids with known smears, for tests."""

import numpy as np
from numpy.typing import ArrayLike

from blur2view.smears.grid import SmearGrid, to_double_angle


def grid_of(
    displacement: ArrayLike,
    sigma_px: ArrayLike = 0.2,
    *,
    stride: int = 1,
    shape: tuple[int, int] | None = None,
) -> SmearGrid:
    """Return a grid of smears (h, w, 2) that err each for themselves, by ``sigma_px`` in every direction."""
    d = np.asarray(displacement, np.float32)
    sigma = np.broadcast_to(np.asarray(sigma_px, np.float32), d.shape[:2])
    length = np.maximum(np.hypot(d[..., 0], d[..., 1]), 1.0)
    angle = 0.5**0.5 * sigma / length
    cells = np.concatenate([to_double_angle(d), sigma[..., None], angle[..., None]], axis=-1)
    height, width = (stride * side for side in d.shape[:2])
    return SmearGrid(
        cells=cells.astype(np.float32), stride=stride, shape=shape or (height, width), window_px=None
    )
