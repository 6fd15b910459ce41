"""Smears, the paths of pixels during the exposure, known up to the sign of their displacements.

A `SmearField` has them at every pixel or at any points, a `SmearGrid` at the cells of a network's grid. A
``.smear.npz`` file stores a grid in half precision, which changes a smear by a hundredth of the network's
error.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from blur2view.arrays import AnyArray, Array
from blur2view.errors import OutputError
from blur2view.files import open_regular
from blur2view.output import GRID_KEY
from blur2view.smears.likelihood import KINDS, OUT_OF_FOCUS, SHARP, SHORTEST_PX, STILL_PX
from blur2view.smears.noise import WINDOW_PX

Floats = NDArray[np.floating[Any]]

# Probability of no smear from which a cell's short smear is taken for an error: the share within one standard
# deviation.
SURE_STILL = 0.68
BLUR_KEY = "blur_grid"

DAMAGE = (OSError, EOFError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError,
          RuntimeError, MemoryError, BadZipFile)  # fmt: skip
"""What the readers of ZIP and NPY raise of damaged bytes; RuntimeError of an archive with a password."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearField:
    """Smears and their uncertainty: of every pixel of an image, (H, W), or at N points of it, (N,)."""

    displacement: NDArray[np.float32]  # (..., 2): d = end - start, pixels, (x, y), of arbitrary sign
    sigma_px: NDArray[np.float32]  # (...): standard deviation of the end-point error |d - d*|
    sigma_rad: NDArray[np.float32]  # (...): that of the direction

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the sigmas: height and width of the image, or the number of points."""
        return self.sigma_px.shape

    @property
    def length_px(self) -> NDArray[np.float32]:
        """Length |d| of every smear (...), pixels."""
        return np.hypot(self.displacement[..., 0], self.displacement[..., 1])


def to_double_angle(displacement: ArrayLike) -> Floats:
    """Return |d| (cos 2phi, sin 2phi) of displacements d (..., 2), phi their angle; the same for d and -d."""
    d = np.asarray(displacement)
    length = np.hypot(d[..., 0], d[..., 1])
    # through the unit vector, so that squares of tiny and huge lengths neither underflow nor overflow
    x, y = np.moveaxis(d / np.where(length > 0, length, 1)[..., None], -1, 0)
    return np.stack([length * (x**2 - y**2), length * (2 * x * y)], -1)


def from_double_angle(double_angle: ArrayLike) -> Floats:
    """Return the displacements (..., 2) of vectors |d| (cos 2phi, sin 2phi), phi in (-90, 90] degrees."""
    u = np.asarray(double_angle)
    length = np.hypot(u[..., 0], u[..., 1])
    phi = np.arctan2(u[..., 1] + 0.0, u[..., 0]) / 2  # + 0.0 turns -0.0 into 0.0: phi is 90, never -90
    return np.stack([length * np.cos(phi), length * np.sin(phi)], -1)


def smear_ends(points: ArrayLike, displacement: ArrayLike) -> NDArray[np.float64]:
    """Return the ends p - d/2 and p + d/2 (N, 2, 2) of smears d (N, 2) with midpoints p (N, 2), pixels.

    ValueError for arrays of other shapes.
    """
    p = np.asarray(points, dtype=np.float64)
    half = np.asarray(displacement, dtype=np.float64) / 2
    if p.shape != half.shape or p.ndim != 2 or p.shape[1] != 2:
        raise ValueError(f"expected two arrays of shape (N, 2), got {p.shape} and {half.shape}")
    return np.stack([p - half, p + half], axis=1)


def upsample_grid(grid: NDArray[np.float32], stride: int) -> NDArray[np.float32]:
    """Interpolate a grid of cells (h, w, C), in double angle, at pixels: (h*stride, w*stride, C), float32."""
    height, width, channels = grid.shape
    # OpenCV has centres at integer + 0.5 cells, which is pixel stride*j + (stride-1)/2, as in `SmearGrid`
    resized = cv2.resize(grid, (width * stride, height * stride), interpolation=cv2.INTER_LINEAR)
    return resized.reshape(height * stride, width * stride, channels).astype(np.float32, copy=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearGrid:
    """Smears and their uncertainty at the cells of a grid: the output of a network for one photograph.

    Cell j's centre is at pixel stride*j + (stride-1)/2. ValueError if the cells do not cover the photograph.
    """

    cells: NDArray[np.float32]  # (h, w, 4): double angle of d, pixels; sigma_px and sigma_rad of `SmearField`
    stride: int  # pixels per cell
    shape: tuple[int, int]  # height and width of the photograph
    window_px: int | None = (
        WINDOW_PX  # side of the window that a cell is read from; None: cells err independently
    )
    # (h, w, 6): radius out of focus, pixels, and probabilities of `likelihood.KINDS`; None: not known
    blur: NDArray[np.float32] | None = None
    # (h, w, 64): probabilities of 32 directions and of 32 lengths (`likelihood`), in pixels of a picture in
    # which a cell has 32; None where no photograph was read
    shares: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        covered = tuple(-(-side // self.stride) for side in self.shape) if self.stride > 0 else ()
        if self.cells.shape != (*covered, 4) or len(covered) != 2:
            got = f"{self.cells.shape}, stride {self.stride} and shape {self.shape}"
            raise ValueError(f"expected cells (h, w, 4) that cover a photograph, got {got}")
        if self.blur is not None and self.blur.shape != (*covered, 1 + len(KINDS)):
            raise ValueError(f"expected blur (h, w, {1 + len(KINDS)}) of the cells, got {self.blur.shape}")

    def __repr__(self) -> str:
        rows, columns, _ = self.cells.shape
        return f"<SmearGrid of {self.shape[1]}x{self.shape[0]} px in {columns}x{rows} cells>"

    @property
    def kinds(self) -> NDArray[np.float32] | None:
        """Probabilities of the kinds of blur of the cells, (h, w, 5)."""
        return None if self.blur is None else self.blur[..., 1:]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the photograph."""
        return self.shape[1], self.shape[0]

    @property
    def sigma_px(self) -> NDArray[np.float32]:
        """Standard deviations of the cells' smears, (h, w), pixels.

        A short smear of a cell that is surely not smeared is an error, so its length replaces a larger
        deviation. In 46 sharp photographs, also at an eighth of their brightness, the median is then 0.5 px
        (else 5.0); for smears of 6 to 16 px it does not change.
        """
        smears = self.smears()
        if self.kinds is None:
            return smears.sigma_px
        still = self.kinds[..., [SHARP, OUT_OF_FOCUS]].sum(-1)
        short = (still >= SURE_STILL) & (smears.length_px < SHORTEST_PX)
        least = np.minimum(smears.sigma_px, np.hypot(smears.length_px, np.float32(STILL_PX)))
        return np.where(short, least, smears.sigma_px)

    def points(self) -> Array:
        """Return the centres of the cells, (h, w, 2), pixels (x, y); the last may lie beyond the border."""
        y, x = (self.stride * np.arange(count) + (self.stride - 1) / 2 for count in self.cells.shape[:2])
        return np.stack(np.meshgrid(x, y), axis=-1)

    def smears(self) -> SmearField:
        """Return the smears of the cells themselves, (h, w)."""
        return _decoded(self.cells)

    def at(self, points: Array) -> SmearField:
        """Return the smears at pixels (N, 2), interpolated in double angle, constant beyond outer cells."""
        height, width = self.cells.shape[:2]
        cell = (np.asarray(points, float) - (self.stride - 1) / 2) / self.stride
        column, row = np.clip(cell, 0, [width - 1, height - 1]).T
        left, top = np.floor(column).astype(int), np.floor(row).astype(int)
        right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
        across, down = (column - left)[:, None], (row - top)[:, None]
        above, below = (
            (1 - across) * self.cells[line, left] + across * self.cells[line, right] for line in (top, bottom)
        )
        return _decoded(((1 - down) * above + down * below).astype(np.float32))

    def at_pixels(self) -> SmearField:
        """Return the smears of every pixel, (H, W), interpolated in double angle."""
        height, width = self.shape
        return _decoded(upsample_grid(self.cells, self.stride)[:height, :width])


def _decoded(cells: NDArray[np.float32]) -> SmearField:
    """Return the smears of cells (..., 4)."""
    sigma_px, sigma_rad = np.moveaxis(np.maximum(cells[..., 2:], 0), -1, 0)
    displacement = np.asarray(from_double_angle(cells[..., :2]), np.float32)
    return SmearField(displacement=displacement, sigma_px=sigma_px, sigma_rad=sigma_rad)


def stored_smears(grid: SmearGrid) -> dict[str, AnyArray]:
    """Return the arrays of a ``.smear.npz`` file by name: cells (h, w, 4) and blur (h, w, 6) as float16."""
    scalars = {"stride": grid.stride, "shape": grid.shape, "window_px": grid.window_px or 0}
    blur = {} if grid.blur is None else {BLUR_KEY: grid.blur.astype(np.float16)}
    arrays = {name: np.array(value) for name, value in scalars.items()}
    return {GRID_KEY: grid.cells.astype(np.float16), **blur, **arrays}


MAX_BYTES = 1 << 28  # bound, of a file's arrays; the largest photograph has 12 MB of them


def load_smears(path: str | Path) -> SmearGrid:
    """Read the smears of a ``.smear.npz`` file of ``estimate -o``.

    Parameters
    ----------
    path : path
        The file.

    Returns
    -------
    SmearGrid
        The smears, as ``estimate.grid`` held them, their cells (h, w, 4) to the precision of the file.

    Raises
    ------
    OutputError
        If the file cannot be read, or holds anything else.

    Examples
    --------
    >>> import blur2view
    >>> from blur2view.cli.commands import main
    >>> main(["estimate", "models/sample.jpg", "-o", "results", "--quiet"])
    0
    >>> blur2view.load_smears("results/sample.smear.npz").shape
    (540, 960)
    """
    try:
        with open_regular(path) as file, np.load(file, allow_pickle=False) as arrays:
            if sum(member.file_size for member in arrays.zip.infolist()) > MAX_BYTES:
                raise ValueError("more than a photograph's smears")  # packed zeros would fill the memory
            cells = arrays[GRID_KEY].astype(np.float32)
            blur = arrays[BLUR_KEY].astype(np.float32) if BLUR_KEY in arrays else None
            if not np.isfinite(cells).all() or (blur is not None and not np.isfinite(blur).all()):
                raise ValueError("smears must be finite")
            height, width, stride, window_px = map(
                int, (*arrays["shape"], arrays["stride"], arrays["window_px"])
            )
            shape, window = (height, width), window_px or None
            return SmearGrid(cells=cells, blur=blur, stride=stride, shape=shape, window_px=window)
    except FileNotFoundError:
        raise OutputError(f"{path}: no such file; write it with blur2view estimate -o") from None
    except DAMAGE:
        remedy = "write it again with blur2view estimate -o"
        raise OutputError(f"{path}: is not a whole .smear.npz file of blur2view; {remedy}") from None
