"""Blur kernels, for programs that deconvolve: those of a photograph's cells, and of the photograph."""

from __future__ import annotations

import io
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array, Floats
from blur2view.output import KERNELS_KEY
from blur2view.smears.blur import Blur, BlurKind
from blur2view.smears.blur_map import is_sure
from blur2view.smears.grid import SmearGrid
from blur2view.smears.likelihood import BOTH, CANNOT_TELL, IN_FOCUS_PX, OUT_OF_FOCUS, SMEARED

SAMPLES_A_PX = 4  # points along a smear a pixel of its length: bound
LARGEST_PX = 511  # side of a kernel; a longer smear is cut off there, which keeps a file below a gigabyte
OUT_OF_FOCUS_KINDS = (BlurKind.OUT_OF_FOCUS, BlurKind.OUT_OF_FOCUS_AND_MOVED)
DISC_SUBPIXELS = 8  # along each side of a pixel, of which a disc covers some: bound


@dataclass(frozen=True, kw_only=True, eq=False)
class BlurKernels:
    """The blur kernels of a photograph: of its cells, and of the photograph as a whole.

    A kernel is what a point of light becomes, in linear light: not negative, of sum 1, centred on its middle
    pixel, in pixels of the photograph. A reversal of time does not change it.
    """

    whole: Floats
    """(K, K): the kernel of the smear and defocus of the photograph's record, or, where smears run in many
    directions, the mean of the cells' kernels."""
    cells: NDArray[np.float16]
    """(h, w, K, K): the kernel of every cell; where a cell cannot tell, that of the whole."""
    known: NDArray[np.bool_]
    """(h, w): whether a cell shows its blur."""
    stride: int
    """Pixels a cell: the centre of cell j is at pixel stride j + (stride - 1) / 2."""

    def to_npz(self) -> bytes:
        """Return the content of a file ``.npz``: whole, blur_kernels (the cells), known and stride."""
        file = io.BytesIO()
        arrays = {"whole": self.whole, KERNELS_KEY: self.cells, "known": self.known}
        np.savez_compressed(file, stride=np.array(self.stride), **arrays)  # type: ignore[arg-type]  # as in cli
        return file.getvalue()


def blur_kernels(grid: SmearGrid, blur: Blur) -> BlurKernels:
    """Return the blur kernels of a photograph.

    Parameters
    ----------
    grid : SmearGrid
        Its smears and kinds of blur: ``estimate.grid``.
    blur : Blur
        What blurred it as a whole: ``estimate.blur``.

    Returns
    -------
    BlurKernels
        A cell is smeared, or out of focus, where the network finds this likelier than not, and smeared
        only by a smear longer than its deviation.

    Raises
    ------
    ValueError
        If the grid has no kinds of blur, because another network read it.

    Examples
    --------
    >>> import blur2view
    >>> estimate = blur2view.estimate("models/sample.jpg")
    >>> kernels = blur2view.blur_kernels(estimate.grid, estimate.blur)
    >>> kernels.cells.shape == (*estimate.grid.cells.shape[:2], *kernels.whole.shape)
    True
    >>> round(float(kernels.whole.sum()), 3)
    1.0
    """
    if grid.kinds is None or grid.blur is None:
        raise ValueError("expected smears with kinds of blur, as SmearNetwork reads them off a photograph")
    smeared = (grid.kinds[..., [SMEARED, BOTH]].sum(-1) > 0.5) & is_sure(grid)
    soft = grid.kinds[..., [OUT_OF_FOCUS, BOTH]].sum(-1) > 0.5
    known = grid.kinds[..., CANNOT_TELL] < 0.5
    displacement = np.where(smeared[..., None], grid.smears().displacement, 0.0).reshape(-1, 2)
    radius = np.where(soft, grid.blur[..., 0], 0.0).ravel()

    angle = np.deg2rad(blur.direction_deg or 0.0)
    length = (blur.smear_px or 0.0) if blur.kind.of_camera else 0.0
    mean_smear = length * np.array([[np.cos(angle), np.sin(angle)]])
    defocus = np.array([(blur.defocus_px or 0.0) if blur.kind in OUT_OF_FOCUS_KINDS else 0.0])

    observed = known.ravel()
    reach_px = np.abs(np.concatenate([displacement[observed], mean_smear])).max() / 2 + 1
    reach_px += np.concatenate([radius[observed], defocus]).max()
    side = min(2 * int(np.ceil(reach_px)) + 1, LARGEST_PX)
    whole = motion_kernels(mean_smear, defocus, side)[0]
    cells = motion_kernels(displacement, radius, side)
    if blur.kind.of_camera and blur.direction_deg is None and observed.any():
        whole = cells[observed].mean(axis=0)
    cells[~observed] = whole
    return BlurKernels(
        whole=whole.astype(np.float32),
        cells=cells.reshape(*known.shape, side, side).astype(np.float16),
        known=known,
        stride=grid.stride,
    )


def motion_kernels(displacement: Array, radius_px: Array, side: int) -> Floats:
    """Return the kernels (N, side, side) of straight, even smears before a lens out of focus.

    ``displacement`` (N, 2) is d in pixels, ``radius_px`` (N,) that of the disc. A path from -d/2 to d/2 is
    sampled evenly, and each sample is shared among the four pixels about it; samples beyond the kernel are
    left out.
    """
    middle, count = (side - 1) / 2, len(displacement)
    longest = float(np.linalg.norm(displacement, axis=1).max(initial=0.0))
    steps = (np.arange(samples := max(int(SAMPLES_A_PX * longest), 1)) + 0.5) / samples - 0.5
    flat = np.zeros((count, side * side), np.float32)
    rows, samples_inside = np.arange(count), np.zeros(count, np.float32)
    for step in steps:
        path = middle + step * displacement
        inside = ((path >= 0) & (path <= side - 1)).all(axis=1)
        samples_inside += inside.astype(np.float32)
        x, y = np.clip(path, 0, side - 1).T
        left, top = np.floor(x).astype(int), np.floor(y).astype(int)
        right, bottom = np.minimum(left + 1, side - 1), np.minimum(top + 1, side - 1)
        across, down = x - left, y - top
        upper, lower = (1 - down) * inside, down * inside
        flat[rows, top * side + left] += (1 - across) * upper
        flat[rows, top * side + right] += across * upper
        flat[rows, bottom * side + left] += (1 - across) * lower
        flat[rows, bottom * side + right] += across * lower
    flat /= np.maximum(samples_inside, np.float32(1))[:, None]
    kernels = flat.reshape(count, side, side)
    for k in np.flatnonzero(radius_px > IN_FOCUS_PX):
        blurred = cv2.filter2D(kernels[k], -1, disc(float(radius_px[k])), borderType=cv2.BORDER_CONSTANT)
        kernels[k] = blurred / blurred.sum()
    return kernels


def disc(radius_px: float) -> Floats:
    """Return the kernel of a lens out of focus by a radius: the share of each pixel that a disc covers."""
    half = int(np.ceil(radius_px))
    fine = (np.arange((2 * half + 1) * DISC_SUBPIXELS) + 0.5) / DISC_SUBPIXELS - half - 0.5
    inside = (fine[:, None] ** 2 + fine**2 <= radius_px**2).astype(np.float32)
    covered = inside.reshape(2 * half + 1, DISC_SUBPIXELS, 2 * half + 1, DISC_SUBPIXELS).mean((1, 3))
    return np.asarray(covered / covered.sum(), np.float32)
