"""The smear network: a checked ONNX file, run on octaves of a photograph, each half of the one before.

The octaves' likelihoods are joined on one axis of lengths, and smears and kinds of blur are read off it. A
large photograph is read in as many windows as an ordinary one, spread over it, and only in the octaves that
its smears need.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from enum import StrEnum
from typing import NamedTuple, Protocol, runtime_checkable

import cv2
import numpy as np

from blur2view.arrays import AnyArray, Floats, Mask
from blur2view.images.pixels import floats_of, gain_of, photograph_of
from blur2view.networks.cepstral_peak import refine_on_cepstrum, repeated
from blur2view.networks.model_file import (
    SMEAR,
    Execution,
    OnnxNetwork,
    model_path,
    one_thread,
    shipped,
    usable_cores,
)
from blur2view.networks.spectra import STEP, WINDOW, in_batches, polar_cepstra, power_spectra, windows_of
from blur2view.smears.grid import SmearGrid
from blur2view.smears.likelihood import (
    BINS,
    CANNOT_TELL,
    DIRECTIONS,
    KINDS,
    PER_OCTAVE,
    lengths_px,
    read_radii,
    read_smears,
    shares_of,
    softmax,
    with_unseen,
)
from blur2view.smears.noise import WINDOW_PX

MAX_OCTAVES = 4  # bound, within the network's reach of 2 to 38 px; the photograph is the first
MIN_HALVED_PX = 90  # shorter side of the smallest octave: one window has 96 px
MIN_SIDE_PX = 64  # of the smallest octave, mirrored up to it: two cells, more than its mirrored border
LARGE_PX = 2_500_000  # bound, pixels: all windows of smaller photographs are read, and all memory is kept
LONG_PX = 12.0  # bound, octave's pixels: a finer octave adds nothing to longer smears
SHORT_BINS = int(np.searchsorted(lengths_px(BINS), LONG_PX))
MAX_SHORT = 0.1  # bound: mean probability of shorter smears up to which the finer octave is not read
ROWS = 4  # of cells, decoded at a time: a core's cache holds their likelihoods
LENGTHS = 32  # lengths of `SmearGrid.shares`: those of four octaves
VALUES = 5 + len(KINDS) + DIRECTIONS + LENGTHS  # of a cell
FLAT_PX = 33  # side of the windows in which one grey level of 255 or less shows nothing
UNSEEN_SIGMA_PX, UNSEEN_SIGMA_RAD = 1000.0, np.pi / 2  # of cells that show nothing: constant, burnt out
STRIP_ROWS = 64  # converted at a time, so that memory never holds all of a large photograph as floats


class Detail(StrEnum):
    """The purpose of a photograph's smears, which decides how many windows are read."""

    GEOMETRY = "geometry"  # motion and masks: of more than 2.5 megapixels some thousand windows
    RANKING = "ranking"  # the order of photographs by their blur: some fifty to two hundred windows


MIN_CELLS = {Detail.GEOMETRY: 700, Detail.RANKING: 50}  # where not all windows are read; at most four times


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
        of blur is unknown. ValueError if it is not a photograph as `photograph_of` takes it; ModelError if
        the network breaks its format's promise.
        """
        image = photograph_of(image)
        apart = STEP << _spread(image.shape, Detail(detail))  # also of a string
        with one_thread:
            values, flat = self._read(image, apart, Detail(detail))
        cells, blur, shares = np.split(values, [4, 5 + len(KINDS)], axis=-1)
        cells[flat] = 0.0, 0.0, UNSEEN_SIGMA_PX, UNSEEN_SIGMA_RAD
        blur[flat] = 0, *np.eye(len(KINDS))[CANNOT_TELL]
        height, width = image.shape[:2]
        window_px = WINDOW_PX * apart // STEP  # as if the picture were smaller
        own = shares if apart == STEP or detail == Detail.GEOMETRY else None
        shape = height, width
        return SmearGrid(cells=cells, blur=blur, shares=own, stride=apart, shape=shape, window_px=window_px)

    def _read(self, image: AnyArray, apart: int, detail: Detail) -> tuple[Floats, Mask]:
        """Read the windows every ``apart`` pixels: values (h, w, 74), and flat cells (h, w)."""
        levels = octave_count(min(image.shape[:2]))
        step = max(apart, STEP << levels - 1)  # whole windows in the smallest octave
        height, width = (-(-max(side, MIN_SIDE_PX << levels - 1) // step) * step for side in image.shape[:2])
        grey = _grey(image, gain_of(image, self._brightness), (height, width))
        flat = _flat(grey[: image.shape[0], : image.shape[1]], apart // STEP)
        if flat.all():
            return np.zeros((*flat.shape, VALUES), np.float32), flat
        pictures = octaves(grey, levels)
        del grey  # a large photograph's
        values = read_octaves(self._network, self._features, pictures, apart, detail)
        return values[: flat.shape[0], : flat.shape[1]], flat


class Octave(NamedTuple):
    """Logits of smears (h, w, 32, B), radii (h, w, B), kinds (h, w, 5); features (h, w, 32, C)."""

    smears: Floats
    radii: Floats
    kinds: Floats
    features: Floats


def read_octaves(
    network: OnnxNetwork,
    features: int,
    pictures: Iterator[tuple[int, Floats]],
    apart: int,
    detail: Detail = Detail.GEOMETRY,
) -> Floats:
    """Read a picture's `octaves`, the smallest first: values (h, w, 74) of cells of ``apart`` pixels.

    ``apart`` is 32 times a power of two; the picture's sides are multiples of a cell in every octave. The
    values of a cell: double angle of its smear and both deviations, radius out of focus, probabilities of
    `KINDS`; the shares of directions and lengths, of the octave in which a cell has 32 pixels and all smaller
    ones. Octaves finer than a cell are read only while the smears may be short.
    """
    threads, spectra, read, shares = network.execution.threads, list[Floats](), None, None
    for k, picture in pictures:
        windows = windows_of(picture, max(STEP, apart >> k))
        spectra.insert(0, power_spectra(windows, threads))
        shown, frugal = picture if apart >> k <= STEP else thinned(windows), picture.size > LARGE_PX
        del picture, windows  # a large photograph's
        read = read_octave(network, features, shown, spectra[0], read, frugal)
        if apart >> k == STEP:
            shares = _shares(read.smears, threads)
        if k and STEP << k <= apart and not_short(read):
            break
    assert read is not None and shares is not None
    kinds = softmax(read.kinds)
    values = np.zeros((*kinds.shape[:2], VALUES), np.float32)

    def decode(rows: slice) -> None:
        values[rows, :, :4] = read_smears(read.smears[rows])

    in_batches(decode, len(values), threads, ROWS)
    cells = values[..., :4]
    if detail is Detail.GEOMETRY:  # the order of photographs does not depend on a per cent of a length
        cells = refine_on_cepstrum(cells, spectra, threads)
    values[..., :4] = with_unseen(cells, kinds[..., CANNOT_TELL])
    values[..., 4], values[..., 5 : 5 + len(KINDS)] = read_radii(read.radii), kinds
    values[..., [0, 1, 2, 4]] *= 2**k  # which are pixels
    values[..., -DIRECTIONS - LENGTHS :] = shares
    return values


def _shares(smears: Floats, threads: int) -> Floats:
    """Return the shares (h, w, 64) of directions and lengths of logits of smears (h, w, 32, B)."""
    shares = np.empty((*smears.shape[:2], DIRECTIONS + LENGTHS), np.float32)

    def fill(rows: slice) -> None:
        shares[rows] = shares_of(smears[rows], LENGTHS)

    in_batches(fill, len(shares), threads, ROWS)
    return shares


def read_octave(
    network: OnnxNetwork, features: int, grey: Floats, power: Floats, smaller: Octave | None, frugal: bool
) -> Octave:
    """Return the joint logits of an octave and all smaller ones, given its picture and its power spectra."""
    size = power.shape[:2]
    shape, coarse = (*size, DIRECTIONS, features), smaller
    if smaller is not None and smaller.radii.shape[:2] != size:
        coarse = Octave(*(repeated(values, 2)[: size[0], : size[1]] for values in smaller))
    above = np.zeros(shape, np.float32) if coarse is None else coarse.features
    outputs = network.run(grey[None], *polar_cepstra(power, network.execution.threads), above, frugal=frugal)
    expected = [(*size, DIRECTIONS, BINS), (*size, BINS), (*size, len(KINDS)), shape]
    if (found := [output.shape for output in outputs]) != expected:
        raise network.error(f"gives shapes {found}")
    own = Octave(*outputs)
    if coarse is None:
        return own
    return own._replace(smears=joined(own.smears, coarse.smears), radii=joined(own.radii, coarse.radii))


def not_short(read: Octave) -> bool:
    """Return whether the smears are too long for a finer octave to add anything."""
    likelihood = np.exp(read.smears - read.smears.max((-2, -1), keepdims=True))
    short = likelihood[..., :SHORT_BINS].sum((-2, -1)) / likelihood.sum((-2, -1))
    known = 1 - softmax(read.kinds)[..., CANNOT_TELL]
    return bool((short * known).sum() < MAX_SHORT * known.sum())


def thinned(windows: Floats) -> Floats:
    """Return every third pixel of windows (h, w, 96, 96) as a picture: the network counts clipped pixels."""
    h, w = windows.shape[:2]
    every = WINDOW // STEP
    return np.ascontiguousarray(windows[:, :, 1::every, 1::every].swapaxes(1, 2)).reshape(h * STEP, w * STEP)


def octave_count(side: int) -> int:
    """Return the number of octaves of a picture whose shorter side has ``side`` pixels."""
    return min(MAX_OCTAVES, 1 + int(np.log2(max(side / MIN_HALVED_PX, 1))))


def octaves(grey: Floats, count: int) -> Iterator[tuple[int, Floats]]:
    """Yield the octaves of a picture (H, W) with their numbers, the smallest first; it is number 0."""
    levels = [grey]
    del grey  # so that its memory is freed as it is read
    for _ in range(count - 1):
        height, width = levels[-1].shape
        half = cv2.resize(levels[-1], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(half, np.float32))
    while levels:
        yield len(levels) - 1, levels.pop()


def joined(fine: Floats, coarse: Floats) -> Floats:
    """Add logits (h, w, ..., B) of an octave and (h, w, ..., C) of all smaller ones on one axis of lengths.

    A length in the smaller octave stands one octave up the axis; the ends are repeated beyond an axis.
    """
    same = [(0, 0)] * (fine.ndim - 1)
    own = np.pad(fine, [*same, (0, coarse.shape[-1] + PER_OCTAVE - fine.shape[-1])], mode="edge")
    own += np.pad(coarse, [*same, (PER_OCTAVE, 0)], mode="edge")
    return own


def _spread(shape: tuple[int, ...], detail: Detail) -> int:
    """Return log2 of the distance of windows over 32 px; 0 if every window is read."""
    pixels = shape[0] * shape[1]
    if detail is Detail.GEOMETRY and pixels <= LARGE_PX:
        return 0
    return int(np.log2(max(pixels / STEP**2 / MIN_CELLS[detail], 1))) // 2


def _grey(image: AnyArray, gain: float, shape: tuple[int, int]) -> Floats:
    """Return the luma of a photograph times ``gain``, mirrored right and below up to a shape."""
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


def _flat(grey: Floats, times: int) -> Mask:
    """Mark the cells (h, w) of a picture, reduced ``times``, about which its grey level does not change."""
    size = -(-grey.shape[1] // times), -(-grey.shape[0] // times)
    shown = cv2.convertScaleAbs(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), alpha=255)
    window = np.ones((FLAT_PX, FLAT_PX), np.uint8)
    contrast = cv2.subtract(cv2.dilate(shown, window), cv2.erode(shown, window))
    rows, columns = (np.minimum(np.arange(0, n, STEP) + STEP // 2, n - 1) for n in shown.shape)
    return contrast[np.ix_(rows, columns)] <= 1
