"""What blurred a photograph, and by how much: `Blur`, from which its record and verdict are made.

`blur2view.smears.camera_motion` decides on the kind; the figures are measured here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray, Floats, ranked, white_level
from blur2view.smears.grid import SmearGrid, to_double_angle
from blur2view.smears.likelihood import CANNOT_TELL, SHORTEST_PX

MIN_KNOWN = 0.04  # share of the cells of which the kind of blur must be known
DEFOCUSED_PX = 2.0  # radius, of what is sharpest, above which a photograph is out of focus
# Values below, or above, which a photograph is too dark, or overexposed; the share of it that may be
# brighter, or darker, and that where the cells know no kind of blur.
DARK, BRIGHT, OTHER, OTHER_UNKNOWN = 0.04, 0.98, 0.001, 0.02
TOO_DARK, OVEREXPOSED = "too dark", "overexposed"
LEVELS = 16  # different values of what is dark, from which on it has more than 8 bits, and may be read
SAMPLED = 2**16  # pixels whose values are looked at: bound
UNSEEN_PX = 500.0  # standard deviation above which a cell shows no texture: a network gives such cells 1000
KNOWN_BEST = 0.2  # relative deviation of a length below which the cell has hardly more weight: bound
# Length of the mean smear, in double angle, over the mean length, above which the photograph has a direction.
COMMON_DIRECTION = 0.5


class BlurKind(StrEnum):
    """What blurred a photograph."""

    SHARP = "sharp"
    OUT_OF_FOCUS = "out of focus"
    CAMERA_MOVED = "camera moved"
    CAMERA_AT_REST = "camera at rest"  # something in the picture moves; the camera does not
    OUT_OF_FOCUS_AND_MOVED = "out of focus and moved"
    CANNOT_TELL = "cannot tell"

    @property
    def of_camera(self) -> bool:
        """Whether the camera moved, so that two views of the exposure differ."""
        return self in CAMERA_KINDS


CAMERA_KINDS = BlurKind.CAMERA_MOVED, BlurKind.OUT_OF_FOCUS_AND_MOVED
"""The kinds of blur of a camera that moved."""


@dataclass(frozen=True, kw_only=True)
class Blur:
    """The blur of a photograph as a whole; values are None where no cell shows them."""

    kind: BlurKind
    smear_px: float | None = None  # length of the photograph's smear: `with_length`
    smear_sigma_px: float | None = None  # its standard deviation
    # Direction of the mean smear in double angle, 0 to 180 degrees, from the x axis towards y, which points
    # down; None where smears run in many directions.
    direction_deg: float | None = None
    # Radius of the disc which spreads as widely as the lens does: of what is in focus, if anything is, else
    # of what is not; and its standard deviation between cells.
    defocus_px: float | None = None
    defocus_sigma_px: float | None = None
    moving_share: float = 0.0  # of the picture that moves by itself; 0 unless movers were looked for
    camera_moved: float | None = None  # probability that the camera moved; None where nothing is seen
    nothing_seen: str = ""  # why nobody can tell: too dark, overexposed, one colour, smears within errors

    @property
    def reason(self) -> str:
        """The kind of blur, with its figures."""
        if self.kind is BlurKind.OUT_OF_FOCUS:
            return f"out of focus by a radius of {self.defocus_px:.1f} px"
        if self.kind is BlurKind.CAMERA_AT_REST:
            return f"{100 * self.moving_share:.0f} % of the picture moves, not what is around it"
        if self.kind is BlurKind.CANNOT_TELL:
            return self.nothing_seen or "smooth all over, so that no blur is seen"
        return str(self.kind)

    @property
    def is_short(self) -> bool:
        """Whether the smear is no longer than its standard deviation, so that it may be no blur."""
        return (self.smear_px or 0.0) <= (self.smear_sigma_px or 0.0)


def knows_kinds(grid: SmearGrid) -> bool:
    """Whether the cells know enough of the kinds of blur; True of a grid without kinds."""
    return grid.kinds is None or float(1 - grid.kinds[..., CANNOT_TELL].mean(dtype=float)) >= MIN_KNOWN


def nothing_seen(image: AnyArray, grid: SmearGrid) -> str:
    """Return why a photograph (uint8, uint16 or 0 to 1) shows nothing, by its brightness; "" if it may.

    What is noise alone, as under a lens cap, looks sharp to a network, so that its brightness decides:
    almost all of it must be dark, or burnt out; less of it where the cells of its ``grid`` know nothing.
    """
    white = white_level(image)
    every = max(int((image.shape[0] * image.shape[1] / SAMPLED) ** 0.5), 1)
    values, kinds_known = image[::every, ::every], knows_kinds(grid)
    exempt_share = OTHER if kinds_known else OTHER_UNKNOWN
    last = values.size - 1
    exempt = int(exempt_share * last)
    low, high = ranked(values, [exempt, last - exempt]).astype(float) / white
    if high < DARK and (not kinds_known or len(np.unique(values[values < DARK * white])) <= LEVELS):
        return TOO_DARK
    if low > BRIGHT:
        return OVEREXPOSED
    return "one colour all over, or transparent" if high - low < 1 / 255 else ""


def with_length(blur: Blur, grid: SmearGrid, kind_weight: NDArray[np.float64] | None = None) -> Blur:
    """Return the blur with length, standard deviation and direction of the photograph's smear.

    Length and deviation are medians over the cells, weighed by ``1 / (c^2 + (sigma / (length + 2 px))^2)``,
    c KNOWN_BEST, and by the probability ``kind_weight`` (h, w), by default 1. Without texture the blur
    stays as it is.
    """
    smears, sigma = grid.smears(), grid.sigma_px
    textured = sigma < UNSEEN_PX
    if textured.mean() < MIN_KNOWN:
        return blur
    weight = textured / (KNOWN_BEST**2 + (sigma / (smears.length_px + SHORTEST_PX)) ** 2).astype(float)
    if grid.kinds is not None:
        weight = weight * (1 - grid.kinds[..., CANNOT_TELL])
    weight = weight if kind_weight is None else weight * kind_weight
    x, y = (to_double_angle(smears.displacement) * weight[..., None]).sum((0, 1))
    common = np.hypot(x, y) > COMMON_DIRECTION * (smears.length_px * weight).sum()
    return replace(
        blur,
        smear_px=weighted_median(smears.length_px, weight)[0],
        smear_sigma_px=weighted_median(sigma, weight)[0],
        direction_deg=float(np.degrees(np.arctan2(y, x)) / 2 % 180) if common else None,
    )


def weighted_median(values: Floats, weight: NDArray[np.float64]) -> tuple[float, float]:
    """Return the median of values with weights, and half the distance of the quantiles 0.16 and 0.84."""
    order = np.argsort(values, axis=None)
    share = np.cumsum(weight.ravel()[order])
    low, middle, high = values.ravel()[order][np.searchsorted(share, share[-1] * np.array([0.16, 0.5, 0.84]))]
    return float(middle), float(high - low) / 2
