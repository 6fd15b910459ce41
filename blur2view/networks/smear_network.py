"""The smear network: a checked ONNX file, run on photographs.

Of a large photograph it reads as many windows as of an ordinary one, spread over the picture, and only the
octaves that its smears need.
"""

import os
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from blur2view.arrays import AnyArray, over_backdrop
from blur2view.networks.model_file import SMEAR, Execution, OnnxNetwork, model_path, shipped, usable_cores
from blur2view.networks.octave_reader import LARGE_PX, LEAST_PX, VALUES, octave_count, octaves, read_octaves
from blur2view.networks.protocol import Detail
from blur2view.networks.spectra import STEP
from blur2view.networks.threads import one_thread
from blur2view.smears.grid import SmearGrid
from blur2view.smears.likelihood import CANNOT_TELL, KINDS
from blur2view.smears.noise import WINDOW_PX

Floats = NDArray[np.float32]

LEAST_CELLS = {Detail.GEOMETRY: 700, Detail.RANKING: 50}  # where not every window is read; four times at most
FLAT_PX = 33  # where at most one grey level of 255 is seen within this many pixels nothing can be measured
UNSEEN_SIGMA_PX, UNSEEN_SIGMA_RAD = 1000.0, np.pi / 2  # of such cells: constant pictures, burnt skies
STRIP_ROWS = 64  # converted at a time, so that memory never holds all of a large photograph as RGB floats
# Which of a photograph's values says how bright it is, what it is brought to, and by how much at most.
QUANTILE, BRIGHT, LARGEST_GAIN = 0.995, 0.9, 256.0
SAMPLES = 1_000_000  # values at least, where there are as many, that the quantile is taken of
LEVELS_OF_8_BITS = np.arange(256, dtype=np.float32) / np.float32(255)
EXPECTED = "expected a photograph (H, W, 3) RGB or (H, W) grey, of uint8, uint16 or floats in [0, 1]"


class SmearNetwork:
    """A loaded smear network; load once, predict many times.

    Of a file that ``tools/training/export.py`` wrote, by default the shipped one; ``info`` is what it says
    of itself. Results do not depend on ``threads``, by default all cores; ``providers`` of ONNX Runtime, as
    ``["cuda"]``, are tried before the processor and differ by rounding. ModelError if the file is missing,
    not ONNX, or no network of this format, or there is no such provider.
    """

    def __init__(
        self,
        path: str | os.PathLike[str] | None = None,
        *,
        threads: int | None = None,
        providers: Sequence[str] = (),
    ) -> None:
        self.path = model_path(path)
        providers = (providers,) if isinstance(providers, str) else tuple(providers)
        self.execution = Execution(threads=threads or usable_cores(), providers=providers)
        ships = self.path == model_path(None)
        self._network = (
            shipped(SMEAR, self.execution) if ships else OnnxNetwork(SMEAR, self.path, self.execution)
        )
        self.info = self._network.metadata
        try:
            self._features = int(self._network.session.get_inputs()[-1].shape[-1])
            self._brightness = float(self.info.get("brightness", "0"))
        except ValueError as error:
            raise self._network.error(f"has damaged metadata ({error})") from None

    @property
    def model_id(self) -> str:
        """Name of the weights."""
        return self._network.model_id

    def __repr__(self) -> str:
        return f"<SmearNetwork {self.model_id} of {self.path.name}, a cell every {STEP} px>"

    def predict(self, image: AnyArray, *, detail: Detail = Detail.GEOMETRY) -> SmearGrid:
        """Return the smear and its sigma at every cell of the network's grid, in the image's pixels.

        Of a photograph as :func:`rgb_of` takes it; of a large one some windows, spread over it, as many as
        ``detail`` needs. Without any texture the smear is zero, the sigmas are ``UNSEEN_SIGMA_PX`` and
        ``UNSEEN_SIGMA_RAD``, and the kind of blur is unknown. ValueError if it is no such image; ModelError
        if the network breaks its format's promise.
        """
        image = photograph_of(image)
        apart = STEP << _spread(image.shape, Detail(detail))  # a word will do
        with one_thread:
            values, flat = self._read(image, apart)
        cells, blur, shares = np.split(values, [4, 5 + len(KINDS)], axis=-1)
        cells[flat] = 0.0, 0.0, UNSEEN_SIGMA_PX, UNSEEN_SIGMA_RAD
        blur[flat] = 0, *np.eye(len(KINDS))[CANNOT_TELL]
        height, width = image.shape[:2]
        window_px = WINDOW_PX * apart // STEP  # as if the picture were smaller
        own, shape = shares if apart == STEP else None, (height, width)
        return SmearGrid(cells=cells, blur=blur, shares=own, stride=apart, shape=shape, window_px=window_px)

    def _read(self, image: AnyArray, apart: int) -> tuple[Floats, NDArray[np.bool_]]:
        """Return what is read of windows so far apart, (h, w, 74), and which of these cells are flat."""
        levels = octave_count(min(image.shape[:2]))
        step = max(apart, STEP << levels - 1)  # whole windows in the smallest octave
        height, width = (-(-max(side, LEAST_PX << levels - 1) // step) * step for side in image.shape[:2])
        grey = _grey(image, gain_of(image, self._brightness), (height, width))
        flat = _flat(grey[: image.shape[0], : image.shape[1]], apart // STEP)
        if flat.all():
            return np.zeros((*flat.shape, VALUES), np.float32), flat
        pictures = octaves(grey, levels)
        del grey  # a large photograph's
        values = read_octaves(self._network, self._features, pictures, apart)
        return values[: flat.shape[0], : flat.shape[1]], flat


def _spread(shape: tuple[int, ...], detail: Detail) -> int:
    """Return the octave whose cells are spread over a photograph; 0 if every window is read."""
    pixels = shape[0] * shape[1]
    if detail is Detail.GEOMETRY and pixels <= LARGE_PX:
        return 0
    return int(np.log2(max(pixels / STEP**2 / LEAST_CELLS[detail], 1))) // 2


def rgb_of(image: AnyArray | Image.Image) -> Floats:
    """Return a photograph as the network reads it: (H, W, 3), float32, sRGB-coded RGB in [0, 1], contiguous.

    Of (H, W), (H, W, 1), (H, W, 3) RGB (OpenCV's BGR as ``image[..., ::-1]``) or (H, W, 4), transparent on
    mid-grey; of uint8, uint16 or floats in [0, 1]; or a picture of Pillow. ValueError of anything else.
    """
    return floats_of(photograph_of(image))


def photograph_of(image: AnyArray | Image.Image) -> AnyArray:
    """Return what `rgb_of` takes as an array (H, W, 3) or (H, W), in its bits, or raise its ValueError."""
    if isinstance(image, Image.Image):
        deep, mode = image.mode[0] in "IF", "RGBA" if image.has_transparency_data else "RGB"
        image = np.asarray(image if deep else image.convert(mode))
    if not isinstance(image, np.ndarray):
        raise ValueError(f"{EXPECTED}, as from read_image(path), got {image!r:.99}")
    integer = image.dtype in (np.uint8, np.uint16)
    has_shape = image.shape[2:] in ((), (1,), (3,), (4,)) and image.ndim > 1 and image.size
    if not has_shape or not (integer or np.issubdtype(image.dtype, np.floating)):
        raise ValueError(f"{EXPECTED}, got {image.dtype} {image.shape}")
    if not (integer or (image.min() >= 0 and image.max() <= 1)):  # NaN if any value is
        raise ValueError(f"expected finite values in [0, 1], got {image.min():.4g} to {image.max():.4g}")
    if image.shape[2:] == (4,):
        image = over_backdrop(np.asarray(image / np.float32(white_of(image)), np.float32))
    if not integer:
        image = np.asarray(image, np.float32)
    return image[..., 0] if image.shape[2:] == (1,) else image


def white_of(image: AnyArray) -> int:
    """Return the value of white in an array of integers, or of floats in [0, 1]."""
    return np.iinfo(image.dtype).max if np.issubdtype(image.dtype, np.integer) else 1


def floats_of(image: AnyArray, gain: float = 1.0) -> Floats:
    """Return what `photograph_of` returns, or a part of it, as RGB (H, W, 3) in [0, 1], brightened."""
    if image.dtype == np.uint8:  # looked up: a third of the time
        values = np.asarray(
            cv2.LUT(np.ascontiguousarray(image), brightened(LEVELS_OF_8_BITS, gain)), np.float32
        )
    else:
        values = np.ascontiguousarray(image, np.float32)
        if image.dtype == np.uint16:
            values = values / np.float32(65535)
        values = brightened(values, gain)
    return values if values.ndim == 3 else np.repeat(values[..., None], 3, axis=2)


def gain_of(image: AnyArray, brightness: float = BRIGHT) -> float:
    """Return the factor, 1 at least, of the coded values of a photograph that makes it so bright."""
    every = max(int(np.sqrt(3 * image.shape[0] * image.shape[1] / SAMPLES)), 1)
    values = image[::every, ::every].reshape(-1)
    rank = min(int(QUANTILE * len(values)), len(values) - 1)
    bright = float(np.float32(np.partition(values, rank)[rank]) / np.float32(white_of(image)))
    return min(max(brightness / max(bright, 1e-6), 1.0), LARGEST_GAIN)


def brightened(image: Floats, gain: float) -> Floats:
    """Return a photograph, 0 to 1, brighter by a factor; the same array if it is 1."""
    return image if gain == 1 else np.minimum(image * np.float32(gain), np.float32(1))


def _grey(image: AnyArray, gain: float, shape: tuple[int, int]) -> Floats:
    """Return the luma of a photograph so bright; to this shape it continues mirrored, right and below."""
    height, width = image.shape[:2]
    mirrored = np.pad(np.arange(height), (0, shape[0] - height), mode="reflect")
    grey = np.empty(shape, np.float32)
    for first in range(0, shape[0], STRIP_ROWS):
        rows = slice(first, first + STRIP_ROWS)
        rgb: AnyArray = floats_of(image[mirrored[rows]], gain)
        if width % STEP:  # odd columns are rounded otherwise
            rgb = cv2.copyMakeBorder(rgb, 0, 0, 0, -width % STEP, cv2.BORDER_REPLICATE)
        luma = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)[:, :width]
        grey[rows] = cv2.copyMakeBorder(luma, 0, 0, 0, shape[1] - width, cv2.BORDER_REFLECT_101)
    return grey


def _flat(grey: Floats, times: int) -> NDArray[np.bool_]:
    """Return the cells, (h, w), of a picture so many times smaller, about which it keeps its grey level."""
    size = -(-grey.shape[1] // times), -(-grey.shape[0] // times)
    shown = cv2.convertScaleAbs(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), alpha=255)
    window = np.ones((FLAT_PX, FLAT_PX), np.uint8)
    contrast = cv2.subtract(cv2.dilate(shown, window), cv2.erode(shown, window))
    rows, columns = (np.minimum(np.arange(0, n, STEP) + STEP // 2, n - 1) for n in shown.shape)
    return contrast[np.ix_(rows, columns)] <= 1
