"""The smear network: a checked ONNX file, run on photographs.

Of a large photograph it reads as many windows as of an ordinary one, spread over the picture, and only the
octaves that its smears need.
"""

import os
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray
from blur2view.images.pixels import floats_of, gain_of, photograph_of
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

        Of a large photograph it reads some windows, spread over it, as many as ``detail`` needs. Without any
        texture the smear is zero, the sigmas are ``UNSEEN_SIGMA_PX`` and ``UNSEEN_SIGMA_RAD``, and the kind
        of blur is unknown. ValueError if it is no photograph as `photograph_of` takes it; ModelError if the
        network breaks its format's promise.
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
