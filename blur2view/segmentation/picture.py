"""What the picture itself shows of blur, finer than smears are read: gradients, colour, spectra.

Smears are read in windows of 96 pixels. Gradients and colour of squares of a quarter of a cell show where an
object ends, and log spectra of windows of 32 pixels, of the picture and of its half, in which directions it
is blurred.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from blur2view.arrays import AnyArray, Array
from blur2view.segmentation.evidence import FINER, LEAST_GRADIENT, OCTAVES, STRIP, gradients_of
from blur2view.smears.field import to_double_angle, upsample_grid

QUARTER = 2 * FINER  # places of gradients and colour on a cell's side
COARSER = 2  # further octaves of gradients, measured on the places
SURROUNDINGS = 5, 15  # places on a side, from whose mean a colour departs
WINDOW = 32  # pixels on the side of a spectrum, of the picture and of its half
RINGS = 1.0, 2.2, 4.5, 8.0, 13.0  # radii of a spectrum's rings, cycles a window
SECTORS = 16  # directions of a spectrum
LEAST_POWER = 1e-4  # of a window, levels in [0, 1]

Floats = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """What a picture shows over a grid (h, w) of cells.

    Parameters
    ----------
    gradients : ndarray of shape (QUARTER h, QUARTER w, 3 (OCTAVES + COARSER))
        As of `evidence.gradients_of`, of ever larger octaves.
    colour : ndarray of shape (QUARTER h, QUARTER w, 6)
        Departures of CIE Lab from the mean over the surroundings, smaller and larger, over 10.
    spectra : ndarray of shape (FINER h, FINER w, 8, SECTORS)
        Mean log powers in four rings, of the picture and of its half.
    """

    gradients: Array
    colour: Floats
    spectra: Floats

    @classmethod
    def of(cls, image: Floats, grid: tuple[int, int], stride: int) -> Picture:
        """Measure an image (H, W, 3) with cells of ``stride`` pixels."""
        shape = QUARTER * grid[0], QUARTER * grid[1]
        fine = gradients_of(image, grid, stride, QUARTER)
        strips = [
            _strip(image, grid, stride, rows)
            for rows in np.array_split(np.arange(grid[0]), -(-grid[0] // STRIP))
        ]
        lab = np.concatenate([strip[0] for strip in strips])
        coarse = _coarser_gradients(lab[..., 0] / 100, shape)
        around = [(lab - cv2.blur(lab, (side, side))) / 10 for side in SURROUNDINGS]
        return cls(
            gradients=np.concatenate([fine, *coarse], axis=-1),
            colour=np.concatenate(around, axis=-1),
            spectra=np.concatenate([strip[1] for strip in strips]),
        )

    def halves(self) -> Array:
        """Return the gradients of half cells, as `evidence.evidence` takes them."""
        height, width = (side // 2 for side in self.gradients.shape[:2])
        fine = np.ascontiguousarray(self.gradients[..., : 3 * OCTAVES])
        return np.asarray(cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA))

    def spectra_turned(self, camera: Array) -> Floats:
        """Return departures of the log powers from their rings' means, and these, (FINER h, FINER w, 136).

        The first sector is the direction of the camera's motion (h, w, 2), pixels.
        """
        double = upsample_grid(to_double_angle(camera).astype(np.float32), FINER)
        first = (np.arctan2(double[..., 1], double[..., 0]) / 2 % np.pi) / np.pi * SECTORS
        sector = first[..., None] + np.arange(SECTORS)
        whole = np.floor(sector).astype(int)
        share = (sector - whole)[..., None, :]
        one, other = (
            np.take_along_axis(
                self.spectra,
                np.broadcast_to(((whole + k) % SECTORS)[..., None, :], self.spectra.shape),
                axis=-1,
            )
            for k in (0, 1)
        )
        turned = (1 - share) * one + share * other
        mean = turned.mean(axis=-1, keepdims=True)
        both = np.concatenate([turned - mean, mean], axis=-1)
        return np.asarray(both.reshape(*both.shape[:2], -1), np.float32)

    def gradients_turned(self, camera: Array, seen: Array) -> Floats:
        """Return what speaks of blur along the camera's motion and the smears, (QUARTER h, QUARTER w, 51).

        Both are (h, w, 2), pixels. Of every octave the logs of squared gradients along and across and how far
        they are aslant; those of the camera once more, less their medians; and colour.
        """
        logs = []
        for motion in (camera, seen):
            double = upsample_grid(to_double_angle(motion).astype(np.float32), QUARTER)
            unit = double / np.maximum(np.linalg.norm(double, axis=-1, keepdims=True), 1e-6)
            for octave in range(OCTAVES + COARSER):
                logs += _turned(self.gradients[..., 3 * octave : 3 * octave + 3], unit)
        ours = [layer - np.median(layer) for layer in logs[: len(logs) // 2]]
        return np.dstack([*logs, *ours, self.colour]).astype(np.float32)


def _turned(gradients: Array, unit: AnyArray) -> list[Array]:
    """Return logs of mean squared gradients along and across unit double angles, and how aslant they are."""
    total, c, s = np.moveaxis(gradients, -1, 0)
    total = total + LEAST_GRADIENT
    along = (c * unit[..., 0] + s * unit[..., 1]) / total
    aslant = np.abs(s * unit[..., 0] - c * unit[..., 1]) / total
    return [*(np.log(0.5 * total * (1 + sign * along) + LEAST_GRADIENT) for sign in (1, -1)), aslant]


def _coarser_gradients(grey: AnyArray, shape: tuple[int, int]) -> list[AnyArray]:
    """Return products of gradients (rows, columns, 3) of places, and of pairs of places."""
    layers = []
    for octave in range(COARSER):
        small = (
            grey
            if octave == 0
            else cv2.resize(grey, (shape[1] // 2, shape[0] // 2), interpolation=cv2.INTER_AREA)
        )
        dx, dy = (0.125 * cv2.Sobel(small, cv2.CV_32F, *order) for order in ((1, 0), (0, 1)))
        mean = cv2.blur(np.dstack([dx * dx + dy * dy, dx * dx - dy * dy, 2 * dx * dy]), (3, 3))
        layers.append(mean if octave == 0 else cv2.resize(mean, shape[::-1], interpolation=cv2.INTER_LINEAR))
    return layers


def _strip(
    image: Floats, grid: tuple[int, int], stride: int, rows: NDArray[np.intp]
) -> tuple[AnyArray, Floats]:
    """Return CIE Lab of places and spectra of half cells of some rows of cells."""
    above, below = max(rows[0] - 1, 0), min(rows[-1] + 2, grid[0])
    part = image[above * stride : below * stride]
    missing = [(0, (below - above) * stride - part.shape[0]), (0, grid[1] * stride - part.shape[1]), (0, 0)]
    part = np.pad(part, missing, mode="symmetric").astype(np.float32, copy=False)
    shape = (below - above), grid[1]
    lab = cv2.resize(
        cv2.cvtColor(part, cv2.COLOR_RGB2Lab),
        (QUARTER * shape[1], QUARTER * shape[0]),
        interpolation=cv2.INTER_AREA,
    )
    grey = cv2.cvtColor(part, cv2.COLOR_RGB2GRAY)
    half = cv2.resize(grey, (grey.shape[1] // 2, grey.shape[0] // 2), interpolation=cv2.INTER_AREA)
    step = stride // FINER
    places = FINER * shape[0], FINER * shape[1]
    both = np.concatenate([_spectra(grey, step, places), _spectra(half, step // 2, places)], axis=2)
    first, last = rows[0] - above, rows[-1] + 1 - above
    return lab[QUARTER * first : QUARTER * last], both[FINER * first : FINER * last]


def _spectra(grey: AnyArray, step: int, places: tuple[int, int]) -> Floats:
    """Return log powers (rows, columns, rings, SECTORS) of windows about squares of ``step`` pixels."""
    import scipy.fft  # 0.1 s, so only for a mask

    margin = (WINDOW - step) // 2
    windows = sliding_window_view(np.pad(grey, margin, mode="symmetric"), (WINDOW, WINDOW))[::step, ::step]
    hann = np.hanning(WINDOW + 1)[:-1].astype(np.float32)
    weight, means = np.outer(hann, hann), _polar_means()
    rows = []
    for row in windows[: places[0], : places[1]]:
        spectrum = scipy.fft.rfft2((row - row.mean((1, 2), keepdims=True)) * weight)
        power = spectrum.real**2 + spectrum.imag**2
        rows.append(np.log(power.reshape(len(row), -1) @ means + LEAST_POWER))
    return np.stack(rows).reshape(*places, len(RINGS) - 1, SECTORS)


@cache
def _polar_means() -> Floats:
    """Return weights (frequencies, rings SECTORS) that take means of a half spectrum by rings and sectors."""
    x, y = np.meshgrid(np.arange(WINDOW // 2 + 1), np.fft.fftfreq(WINDOW) * WINDOW)
    radius = np.hypot(x, y).ravel()
    angle = (np.arctan2(y, x) % np.pi / np.pi * SECTORS).ravel()
    means = np.zeros((radius.size, len(RINGS) - 1, SECTORS), np.float32)
    for ring, (least, most) in enumerate(zip(RINGS[:-1], RINGS[1:], strict=True)):
        inside = (radius >= least - 0.01) & (radius < most - 0.01)
        for sector in range(SECTORS):
            apart = np.abs((angle - sector + SECTORS / 2) % SECTORS - SECTORS / 2)
            weight = np.maximum(1 - apart / (1.6 if ring < 2 else 1.0), 0) * inside
            if weight.sum() == 0:  # the smallest ring has few frequencies
                weight = np.exp(-0.5 * (apart / 1.5) ** 2) * inside
            means[:, ring, sector] = weight / weight.sum()
    return means.reshape(radius.size, -1)
