"""The smear network: a checked ONNX file, run on octaves of a photograph, each half of the one before.

The octaves' likelihoods are joined on one axis of lengths, and smears and kinds of blur are read off it. A
large photograph is read in as many windows as an ordinary one, spread over it, and only in the octaves that
its smears need.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from enum import StrEnum
from typing import Protocol, runtime_checkable

import cv2
import numpy as np

from blur2view.arrays import AnyArray, Floats, Mask
from blur2view.images.pixels import as_floats, as_photograph, brightness_gain
from blur2view.networks.cepstral_peak import refine_on_cepstrum
from blur2view.networks.look import CELLS, CLOSER_CELLS, look
from blur2view.networks.model_file import (
    SMEAR,
    Execution,
    OnnxNetwork,
    model_path,
    one_thread,
    shipped,
    usable_cores,
)
from blur2view.networks.octaves import (
    CELL_VALUES,
    FLAT_PX,
    LENGTHS,
    not_short,
    octave_count,
    octave_values,
    octaves,
    read_octave,
    thinned,
    with_flat,
)
from blur2view.networks.spectra import STEP, in_batches, power_spectra, sliding_windows
from blur2view.smears.grid import SmearGrid
from blur2view.smears.likelihood import DIRECTIONS, marginals, read_smears
from blur2view.smears.noise import WINDOW_PX

MIN_SIDE_PX = 64  # of the smallest octave, mirrored up to it: two cells, more than its mirrored border
# Pixels up to which all windows are read for geometry and masks, and their memory is kept: bound.
READ_WHOLE_PX = 2_500_000
ROWS = 4  # of cells, decoded at a time: a core's cache holds their likelihoods
VALUES = CELL_VALUES + DIRECTIONS + LENGTHS  # of a cell
STRIP_ROWS = 64  # converted at a time, so that memory never holds all of a large photograph as floats


class Detail(StrEnum):
    """The purpose of a photograph's smears, which decides how many windows are read."""

    GEOMETRY = "geometry"  # motion and masks: of more than 2.5 megapixels some thousand windows
    RANKING = "ranking"  # the order of photographs by their blur, and its kind: `look.CELLS` an octave
    CLOSER = "closer"  # the kind of blur, where the one before leaves it open: `look.CLOSER_CELLS`


NAMED_WHOLE_PX = 650_000
"""Pixels up to which all windows are read to name what blurred a photograph: of 576 of 640x480 and the like
all windows name 468 rightly and looks 459, of 138 of 1280x1024 all windows 115 and looks 128. Between these
sizes one photograph of 960x640 decided, whose camera stood still and which looks name otherwise
(``tools.evaluation.looks PHOTOGRAPHS --sides 640 1280 --closer 96`` compares them)."""


def is_named_by_looks(shape: tuple[int, ...]) -> bool:
    """Return whether what blurred a photograph is named by some of its windows, whatever it is read for."""
    return shape[0] * shape[1] > NAMED_WHOLE_PX


MIN_CELLS = 700
"""Cells of a photograph of which not all windows are read, at least, and at most four times as many. With 300
F is as good (mean rho of 33 frames of RedKitchen through every second, fourth and ninth cell 0.047, 0.047 and
0.044, through all 0.047), but a rotation is less sure: of `models/desk.jpg` 0.23 instead of 0.51
(``tools.evaluation.evaluate SCENES --fewer 33`` compares F of rendered scenes)."""


@runtime_checkable
class SmearReader(Protocol):
    """Interface of a network that reads smears: another architecture is one class."""

    @property
    def model_id(self) -> str:
        """Name of the weights, which results state."""

    @property
    def execution(self) -> Execution:
        """Threads and providers, also of the networks that find movers."""

    def predict(self, image: AnyArray, *, detail: Detail = Detail.GEOMETRY) -> SmearGrid:
        """Return the smears of a photograph (H, W, 3) or (H, W): uint8, uint16, or floats in [0, 1].

        Cells have `stride` pixels; set `window_px` to the side that a cell is read from (None: cells err
        alone). Leave `shares` None, and `blur` too if no kinds are known: the camera is then taken to have
        moved.
        """


class SmearNetwork:
    """A loaded smear network; load once, predict many times.

    ``path`` is a file that ``tools/training/export.py`` wrote, by default the shipped one; ``info`` is its
    metadata. Results do not depend on ``threads``, by default all cores; ``providers`` of ONNX Runtime, as
    ``["cuda"]``, are tried before the processor and differ by rounding. ModelError if the file is missing,
    not ONNX or of another format, or if this ONNX Runtime lacks the provider.
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
        of blur is unknown. ValueError if it is not a photograph as `as_photograph` takes it; ModelError if
        the network breaks its format's promise.
        """
        image, detail = as_photograph(image), Detail(detail)  # also of a string
        with one_thread:
            if detail is not Detail.GEOMETRY:
                count = CELLS if detail is Detail.RANKING else CLOSER_CELLS
                asked = detail is Detail.CLOSER
                return look(self._network, self._features, image, self._brightness, count, shares=asked)
            apart = STEP << _spread(image.shape)
            values, flat = self._read(image, apart)
        cells, blur, shares = np.split(values, [4, CELL_VALUES], axis=-1)
        window_px = WINDOW_PX * apart // STEP  # as if the picture were smaller
        cells, blur = with_flat(cells, blur, flat)
        return SmearGrid(
            cells=cells, blur=blur, shares=shares, stride=apart, shape=image.shape[:2], window_px=window_px
        )

    def _read(self, image: AnyArray, apart: int) -> tuple[Floats, Mask]:
        """Read the windows every ``apart`` pixels: values (h, w, 74), and flat cells (h, w)."""
        levels = octave_count(min(image.shape[:2]))
        step = max(apart, STEP << levels - 1)  # whole windows in the smallest octave
        height, width = (-(-max(side, MIN_SIDE_PX << levels - 1) // step) * step for side in image.shape[:2])
        grey = _grey(image, brightness_gain(image, self._brightness), (height, width))
        flat = _flat(grey[: image.shape[0], : image.shape[1]], apart // STEP)
        if flat.all():
            return np.zeros((*flat.shape, VALUES), np.float32), flat
        pictures = octaves(grey, levels)
        del grey  # a large photograph's
        values = read_octaves(self._network, self._features, pictures, apart)
        return values[: flat.shape[0], : flat.shape[1]], flat


def read_octaves(
    network: OnnxNetwork, features: int, pictures: Iterator[tuple[int, Floats]], apart: int
) -> Floats:
    """Read a picture's `octaves`, the smallest first: values (h, w, 74) of cells of ``apart`` pixels.

    ``apart`` is 32 times a power of two; the picture's sides are multiples of a cell in every octave. The
    values of a cell: those of `octave_values`; the shares of directions and lengths, of the octave in which a
    cell has 32 pixels and all smaller ones. Octaves finer than a cell are read only while the smears may be
    short.
    """
    threads, spectra, read, shares = network.execution.threads, list[Floats](), None, None
    for k, picture in pictures:
        windows = sliding_windows(picture, max(STEP, apart >> k))
        spectra.insert(0, power_spectra(windows, threads))
        shown, frugal = picture if apart >> k <= STEP else thinned(windows), picture.size > READ_WHOLE_PX
        del picture, windows  # a large photograph's
        read = read_octave(network, features, shown, spectra[0], read, frugal)
        if apart >> k == STEP:
            shares = _shares(read.smears, threads)
        if k and STEP << k <= apart and not_short(read):
            break
    assert read is not None and shares is not None
    cells = np.empty((*read.kinds.shape[:2], 4), np.float32)

    def decode(rows: slice) -> None:
        cells[rows] = read_smears(read.smears[rows])

    in_batches(decode, len(cells), threads, ROWS)
    cells = refine_on_cepstrum(cells, spectra, threads)
    return np.concatenate([octave_values(read, cells, k), shares], axis=-1)


def _shares(smears: Floats, threads: int) -> Floats:
    """Return the shares (h, w, 64) of directions and lengths of logits of smears (h, w, 32, B)."""
    shares = np.empty((*smears.shape[:2], DIRECTIONS + LENGTHS), np.float32)

    def fill(rows: slice) -> None:
        shares[rows] = marginals(smears[rows], LENGTHS)

    in_batches(fill, len(shares), threads, ROWS)
    return shares


def _spread(shape: tuple[int, ...]) -> int:
    """Return log2 of the distance of windows over 32 px; 0 if every window is read."""
    pixels = shape[0] * shape[1]
    return int(np.log2(max(pixels / STEP**2 / MIN_CELLS, 1))) // 2 if pixels > READ_WHOLE_PX else 0


def _grey(image: AnyArray, gain: float, shape: tuple[int, int]) -> Floats:
    """Return the luma of a photograph times ``gain``, mirrored right and below up to a shape."""
    height, width = image.shape[:2]
    mirrored = np.pad(np.arange(height), (0, shape[0] - height), mode="reflect")
    grey = np.empty(shape, np.float32)
    for first in range(0, shape[0], STRIP_ROWS):
        rows = slice(first, first + STRIP_ROWS)
        rgb: AnyArray = as_floats(image[mirrored[rows]], gain)
        if width % STEP:  # odd columns are rounded otherwise
            rgb = cv2.copyMakeBorder(rgb, 0, 0, 0, -width % STEP, cv2.BORDER_REPLICATE)
        luma = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)[:, :width]
        grey[rows] = cv2.copyMakeBorder(luma, 0, 0, 0, shape[1] - width, cv2.BORDER_REFLECT_101)
    return grey


def _flat(grey: Floats, times: int) -> Mask:
    """Mark the cells (h, w) of a picture, reduced ``times``, about which its grey level does not change."""
    size = -(-grey.shape[1] // times), -(-grey.shape[0] // times)
    shown = cv2.convertScaleAbs(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), alpha=255)
    window = np.ones((FLAT_PX, FLAT_PX), np.uint8)
    contrast = cv2.subtract(cv2.dilate(shown, window), cv2.erode(shown, window))
    rows, columns = (np.minimum(np.arange(0, n, STEP) + STEP // 2, n - 1) for n in shown.shape)
    return contrast[np.ix_(rows, columns)] <= 1
