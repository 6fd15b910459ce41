"""The smear network: a checked ONNX file, run on whole photographs or on overlapping tiles."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from threadpoolctl import threadpool_limits

from blur2view.arrays import AnyArray, over_backdrop
from blur2view.errors import ModelError
from blur2view.networks.brightness import brightened
from blur2view.networks.model_file import model_path, open_session, read_info, usable_cores
from blur2view.networks.octave_reader import LEAST_PX, OctaveReader
from blur2view.networks.octaves import LEVELS, octave_count
from blur2view.networks.spectra import STEP
from blur2view.networks.tiles import cells, ramps, reflected, spans
from blur2view.smears.blur_kinds import CANNOT_TELL, KINDS
from blur2view.smears.grid import SmearGrid

# Where at most one grey level of 255 is seen within this many pixels, nothing can be measured and the network
# guesses: such cells (constant pictures, burnt skies; 0.04 % of RedKitchen) get no smear and this sigma.
_FLAT_WINDOW_PX = 33
UNSEEN_SIGMA_PX, UNSEEN_SIGMA_RAD = 1000.0, np.pi / 2


class SmearNetwork:
    """A loaded smear network; load once, predict many times.

    Parameters
    ----------
    path : path-like, optional
        An ONNX file written by ``tools/training/export_reader.py``; the shipped one by default.
    threads : int, optional
        Threads of one inference; all cores this process may use by default. The result is the same.

    Raises
    ------
    ModelError
        If the file is missing, not ONNX, or not a network of this format.
    """

    max_pixels = 2_500_000  # larger photographs are read in tiles: 1920x1080 is read in one piece
    tile_px, overlap_px = 1280, 256  # of tiles, whose overlaps are blended

    def __init__(self, path: str | os.PathLike[str] | None = None, *, threads: int | None = None) -> None:
        self.path = model_path(path)
        session = open_session(self.path, threads or usable_cores())
        self.info = read_info(self.path, session)
        self._reader = OctaveReader(self.path, session, self.info)
        self.tiles_at_once = 1  # the result is the same; each takes the memory of one
        self.on_tile: Callable[[int, int], object] = lambda done, count: None
        """Called after each tile of a photograph with the number of tiles done and of all."""

    def __repr__(self) -> str:
        return f"<SmearNetwork {self.info.model_id} of {self.path.name}, a cell every {STEP} px>"

    def predict(self, image: AnyArray, levels: int = LEVELS) -> SmearGrid:
        """Return the smear and its sigma at every cell of the network's grid.

        Parameters
        ----------
        image : ndarray of shape (H, W, 3) or (H, W)
            A photograph as :func:`rgb_of` takes it.
        levels : int
            Sizes at most that are read, the image's own included; the smaller ones for long smears.

        Returns
        -------
        SmearGrid
            In the image's pixels. Where the image shows no texture at all the smear is zero, the sigmas
            are ``UNSEEN_SIGMA_PX`` and ``UNSEEN_SIGMA_RAD``, and the kind of blur cannot be told. The result
            does not depend on how bright the image is, but for its noise.

        Raises
        ------
        ValueError
            If the image is none of these.
        ModelError
            If the network cannot be run or its output is not what its format promises.
        """
        image = brightened(rgb_of(image), self.info.brightness)
        flat = _flat(image, STEP)
        with threadpool_limits(limits=1, user_api="blas"):  # more hinder our own threads: twice the time
            grid = self._cells(image, flat, levels)
        if not np.isfinite(grid).all():
            raise ModelError(f"{self.path}: gives values that are not finite; use the shipped network")
        grid[flat] = (0, 0, UNSEEN_SIGMA_PX, UNSEEN_SIGMA_RAD, 0, *np.eye(len(KINDS))[CANNOT_TELL])
        height, width = image.shape[:2]
        cells, blur = np.split(grid, [4], axis=-1)
        return SmearGrid(cells=cells, blur=blur, stride=STEP, shape=(height, width))

    def _cells(self, image: NDArray[np.float32], flat: NDArray[np.bool_], levels: int) -> NDArray[np.float32]:
        """Return smears and kinds of blur on the network's grid, (h, w, 10), tiles blended.

        Tiles that are flat all over are not read.
        """
        height, width = image.shape[:2]
        tile_px = self.tile_px if height * width > self.max_pixels else max(height, width)
        piece = min(height, width, tile_px)
        levels = octave_count((piece, piece), levels)
        step = STEP << levels - 1  # whole windows in the smallest octave
        *sides, tile_px = (max(side, LEAST_PX << levels - 1) for side in (height, width, tile_px))
        rows, columns = (spans(side, step, tile_px, self.overlap_px) for side in sides)
        shape = rows[-1].stop // STEP, columns[-1].stop // STEP
        total = np.zeros((*shape, 5 + len(KINDS)), np.float32)
        weight = np.zeros((*shape, 1), np.float32)
        tiles = list(product(ramps(rows, STEP), ramps(columns, STEP)))

        pool = ThreadPoolExecutor(self.tiles_at_once)
        try:
            windows = [(cells(row, STEP), cells(column, STEP)) for (row, _), (column, _) in tiles]
            read = pool.map(
                lambda tile, window: (
                    None if flat[window].all() else self._reader.read(reflected(image, *tile), levels)
                ),
                [(row, column) for (row, _), (column, _) in tiles],
                windows,
            )
            for done, (tile, window, grid) in enumerate(zip(tiles, windows, read, strict=True), 1):
                (_, row_weight), (_, column_weight) = tile
                tile_weight = np.outer(row_weight, column_weight)[..., None]
                total[window] += 0 if grid is None else grid * tile_weight
                weight[window] += tile_weight
                self.on_tile(done, len(tiles))
        finally:
            pool.shutdown(cancel_futures=True)  # Ctrl-C waits for the tiles in hand, not for all
        total /= weight
        # a cell that the border cuts is kept; what lies wholly beyond it is padding
        return total[: -(-height // STEP), : -(-width // STEP)]


def rgb_of(image: AnyArray | Image.Image) -> NDArray[np.float32]:
    """Return a photograph as the network reads it: (H, W, 3), float32, sRGB-coded RGB in [0, 1], contiguous.

    Parameters
    ----------
    image : ndarray of shape (H, W), (H, W, 1), (H, W, 3) or (H, W, 4), or a picture of Pillow
        RGB (OpenCV's BGR as ``image[..., ::-1]``) or grey, sRGB-coded: uint8, uint16, or floats in [0, 1];
        contiguous or not. Of RGBA what is transparent shows mid-grey. It is not changed.

    Raises
    ------
    ValueError
        If it is none of these.
    """
    if isinstance(image, Image.Image):
        deep, mode = image.mode[0] in "IF", "RGBA" if image.has_transparency_data else "RGB"
        image = np.asarray(image if deep else image.convert(mode))
    if not isinstance(image, np.ndarray):
        raise ValueError(f"{_EXPECTED}, as from read_image(path), got {image!r:.99}")
    integer = image.dtype in (np.uint8, np.uint16)
    if image.shape[2:] not in ((), (1,), (3,), (4,)) or image.ndim < 2 or not image.size:
        raise ValueError(f"{_EXPECTED}, got {image.dtype} {image.shape}")
    if not (integer or np.issubdtype(image.dtype, np.floating)):
        raise ValueError(f"{_EXPECTED}, got {image.dtype} {image.shape}")
    values = np.ascontiguousarray(image, np.float32)
    if integer:
        values = values / np.float32(np.iinfo(image.dtype).max)
    elif not (values.min() >= 0 and values.max() <= 1):  # NaN if any value is
        raise ValueError(f"expected finite values in [0, 1], got {values.min():.4g} to {values.max():.4g}")
    values = np.atleast_3d(values)
    if values.shape[2] == 4:
        values = over_backdrop(values)
    return values if values.shape[2] == 3 else np.repeat(values, 3, axis=2)


_EXPECTED = "expected a photograph (H, W, 3) RGB or (H, W) grey, of uint8, uint16 or floats in [0, 1]"


def _flat(image: NDArray[np.float32], stride: int) -> NDArray[np.bool_]:
    """Return the cells, (h, w), around which every channel keeps its value, give or take a level of 255."""
    levels = cv2.convertScaleAbs(image, alpha=255)  # rounded, saturated, no float copy
    window = np.ones((_FLAT_WINDOW_PX, _FLAT_WINDOW_PX), np.uint8)
    contrast = cv2.subtract(cv2.dilate(levels, window), cv2.erode(levels, window)).reshape(image.shape)
    rows, columns = (np.minimum(np.arange(0, n, stride) + stride // 2, n - 1) for n in image.shape[:2])
    flat: NDArray[np.bool_] = contrast[np.ix_(rows, columns)].max(axis=-1) <= 1
    return flat
