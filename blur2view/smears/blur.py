"""What blurred a photograph, and by how much: one object that names, ranks and verdicts follow from.

The kinds of blur and radii that a network tells of cells (:mod:`blur2view.smears.likelihood`) are averaged
over the photograph, each cell by how much it can tell. What lies near the border counts more: before a camera
at rest something moves within the picture, and a camera that follows something blurs what is around it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, AnyArray, Floats
from blur2view.smears.grid import SmearGrid, to_double_angle
from blur2view.smears.likelihood import BOTH, CANNOT_TELL, OUT_OF_FOCUS, SHARP, SHORTEST_PX, SMEARED

MIN_KNOWN = 0.04  # share of the cells that must tell their blur
BORDER, BORDER_WEIGHT = 0.15, 3.0  # share of a side that is near the border, and how much more that counts
MOVED = 0.5  # share that must be smeared for the camera to have moved
CLOSE_MOVED = 0.2  # of the share that decides if the camera moved, what is close to its limit
# Length of what is surely smeared, also in standard deviations; share of the cells that must be so.
SURE_PX, SURE_SIGMAS, SURE_SHARE = 3.0, 2.0, 0.01
# Share of the picture that must move, or of the cells that must be smeared, for anything to have moved.
MOVING_SHARE = 0.005
# A camera plainly moved if at most this share of the cells is not smeared, and the median smear this long.
MAX_STILL, PLAIN_PX = 0.1, 4.0
IN_FOCUS = 0.2  # share of what is not smeared that must be sharp: the subject
DEFOCUSED_PX = 2.0  # radius, of what is sharpest, above which a photograph is out of focus
DARK, BRIGHT = 0.02, 0.98  # values below, or above, which a whole photograph is too dark, or overexposed
UNSEEN_PX = 500.0  # standard deviation of what shows no texture, which a network gives 1000, or borders on it
KNOWN_BEST = 0.2  # relative deviation of a length below which it counts no more: bound
# Length of the mean smear, in double angle, over the mean length, from which on there is one direction.
COMMON_DIRECTION = 0.5


class BlurKind(StrEnum):
    """What blurred a photograph."""

    SHARP = "sharp"
    OUT_OF_FOCUS = "out of focus"
    CAMERA_MOVED = "camera moved"
    CAMERA_AT_REST = "camera at rest"  # something moves, or moved in part of the picture; the camera did not
    OUT_OF_FOCUS_AND_MOVED = "out of focus and moved"
    CANNOT_TELL = "cannot tell"

    @property
    def of_camera(self) -> bool:
        """Whether the camera moved, so that two views of the exposure differ."""
        return self in (BlurKind.CAMERA_MOVED, BlurKind.OUT_OF_FOCUS_AND_MOVED)


@dataclass(frozen=True, kw_only=True)
class Blur:
    """The blur of a photograph as a whole; None of what no cell tells."""

    kind: BlurKind
    smear_px: float | None = None  # length of the photograph's smear: `with_length`
    smear_sigma_px: float | None = None  # its standard deviation
    # Of the mean smear in double angle, 0 to 180 degrees, from the x axis towards y, which points down; None
    # where smears run in many directions.
    direction_deg: float | None = None
    # Radius of the disc which spreads as widely as the lens does, out of focus or not: of what is in focus,
    # if anything is; and the deviation between cells.
    defocus_px: float | None = None
    defocus_sigma_px: float | None = None
    moving_share: float = 0.0  # of the picture that moves by itself, where that was asked
    nothing_seen: str = ""  # why nothing can be seen: too dark, overexposed, one colour

    @property
    def reason(self) -> str:
        """What the kind is, with its figures."""
        if self.kind is BlurKind.OUT_OF_FOCUS:
            return f"out of focus by a radius of {self.defocus_px:.1f} px"
        if self.kind is BlurKind.CAMERA_AT_REST:
            return f"{100 * self.moving_share:.0f} % of the picture moves, not what is around it"
        if self.kind is BlurKind.CANNOT_TELL:
            return self.nothing_seen or "smooth all over, so that no blur is seen"
        return str(self.kind)

    @property
    def is_short(self) -> bool:
        """Whether the smear is no longer than its standard deviation: that is no blur."""
        return (self.smear_px or 0.0) <= (self.smear_sigma_px or 0.0)

    def at_rest(self) -> Blur:
        """Return the blur of the same photograph of which it is known that the camera did not move."""
        if not self.kind.of_camera:
            return self
        kind = BlurKind.OUT_OF_FOCUS if self.kind is BlurKind.OUT_OF_FOCUS_AND_MOVED else BlurKind.SHARP
        return replace(self, kind=BlurKind.CAMERA_AT_REST if self.moving_share > MOVING_SHARE else kind)


def blur_of(
    grid: SmearGrid,
    image: AnyArray | None = None,
    moving: AnyArray | None = None,
    camera_moved: float | None = None,
    moving_share: float | None = None,
) -> Blur:
    """Return the blur of a photograph; the photograph itself says why nothing can be seen.

    Of a grid without kinds of blur the camera is taken to have moved. ``moving`` (h, w) is the share of each
    cell that moves by itself, ``moving_share`` that of the picture, ``camera_moved`` the probability that
    the camera did; by default 0, the mean, and that of the cells.
    """
    smeared = with_length(Blur(kind=BlurKind.CAMERA_MOVED), grid)
    if smeared.smear_px is None:
        smeared = replace(smeared, kind=BlurKind.CANNOT_TELL)
    if grid.blur is None:
        return smeared
    kinds = np.asarray(grid.kinds, float)
    known = 1 - kinds[..., CANNOT_TELL]
    if known.mean() < MIN_KNOWN:
        nothing = "" if image is None else nothing_seen(image)
        return replace(smeared, kind=BlurKind.CANNOT_TELL, nothing_seen=nothing)
    share = np.zeros(known.shape) if moving is None else np.asarray(moving)
    moving_share = float(share.mean()) if moving_share is None else moving_share
    kind = kind_of(kinds * (1 - share[..., None]), moving_share, camera_moved)
    if smeared.is_short and camera_moved is None:
        kind = replace(smeared, kind=kind, moving_share=moving_share).at_rest().kind
    in_focus = kind in (BlurKind.SHARP, BlurKind.CAMERA_AT_REST, BlurKind.CAMERA_MOVED)
    weight = kinds[..., [SHARP, SMEARED] if in_focus else [OUT_OF_FOCUS, BOTH]].sum(-1) * known
    radius, spread = weighted_median(grid.blur[..., 0], weight)
    if kind is BlurKind.SHARP and radius > DEFOCUSED_PX:
        kind = BlurKind.OUT_OF_FOCUS
    blur = Blur(kind=kind, defocus_px=radius, defocus_sigma_px=spread, moving_share=moving_share)
    of_kind = kinds[..., [SMEARED, BOTH] if kind.of_camera else [SHARP, OUT_OF_FOCUS]].sum(-1)
    return with_length(blur, grid, of_kind * (1 - share))


def kind_of(kinds: NDArray[np.float64], moving_share: float, camera_moved: float | None = None) -> BlurKind:
    """Return what blurred a photograph of kinds (h, w, 5), weighed by how much of a cell stands still."""
    sharp, defocused, smeared, both = near_border(kinds)
    moved, still = smeared + both, sharp + defocused
    if moved > MOVED * (moved + still) if camera_moved is None else camera_moved > 0.5:
        return BlurKind.OUT_OF_FOCUS_AND_MOVED if both > smeared else BlurKind.CAMERA_MOVED
    if moving_share > MOVING_SHARE:
        return BlurKind.CAMERA_AT_REST
    sharp, defocused = kinds.sum((0, 1))[:SMEARED]
    return BlurKind.OUT_OF_FOCUS if sharp <= IN_FOCUS * (sharp + defocused) else BlurKind.SHARP


def near_border(kinds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return sums (4,) of all kinds but CANNOT_TELL over a photograph, weighed more near the border."""
    near = [np.minimum(np.arange(n), np.arange(n)[::-1]) < BORDER * n for n in kinds.shape[:2]]
    weight = np.where(near[0][:, None] | near[1], BORDER_WEIGHT, 1.0)
    return np.asarray((kinds * weight[..., None]).sum((0, 1))[:CANNOT_TELL])


def smeared_share(grid: SmearGrid) -> float:
    """Return the share of a grid with kinds of blur that is smeared, as it counts for the camera's motion."""
    sums = near_border(np.asarray(grid.kinds, float))
    return float(sums[[SMEARED, BOTH]].sum() / max(sums.sum(), TINY))


def in_doubt(grid: SmearGrid) -> bool:
    """Whether the cells' own blur leaves open if the camera moved: some of it is smeared, some is not."""
    if grid.kinds is None:
        return False
    smeared = (grid.kinds[..., [SMEARED, BOTH]].sum(-1) > 0.5).mean()
    still = (grid.kinds[..., [SHARP, OUT_OF_FOCUS]].sum(-1) > 0.5).mean()
    whole = with_length(Blur(kind=BlurKind.CANNOT_TELL), grid)
    is_plain = still <= MAX_STILL and (whole.smear_px or 0.0) >= PLAIN_PX and not whole.is_short
    return bool(smeared > MOVING_SHARE and not is_plain)


def is_close(grid: SmearGrid) -> bool:
    """Whether a photograph's kind of blur is so close that more windows may show another.

    Of 280 pictures that chose none of the limits, sharp, soft, out of focus, smeared and of DAVIS, this is
    true of 33, and 13 of the others have another kind than by all windows.
    """
    if grid.kinds is None:
        return False
    moved, smears = smeared_share(grid), grid.smears()
    if abs(moved - MOVED) < CLOSE_MOVED:
        return True
    if moved > MOVED:
        seen = blur_of(grid, camera_moved=1.0)
        short = in_doubt(grid) and not with_length(seen, grid).is_short
        return short or (seen.kind is BlurKind.CAMERA_MOVED and (seen.defocus_px or 0.0) > DEFOCUSED_PX)
    sure = smears.length_px > np.maximum(SURE_PX, SURE_SIGMAS * grid.sigma_px)
    return bool((sure & (grid.kinds[..., [SMEARED, BOTH]].sum(-1) > 0.5)).mean() > SURE_SHARE)


def nothing_seen(image: AnyArray) -> str:
    """Return what a photograph's brightness, uint8, uint16 or 0 to 1, says of why it shows nothing."""
    white = np.iinfo(image.dtype).max if np.issubdtype(image.dtype, np.integer) else 1.0
    low, high = np.quantile(image[::4, ::4] / white, (0.02, 0.98))
    if high < DARK:
        return "too dark"
    if low > BRIGHT:
        return "overexposed"
    return "one colour all over, or transparent" if high - low < 1 / 255 else ""


def with_length(blur: Blur, grid: SmearGrid, of_kind: NDArray[np.float64] | None = None) -> Blur:
    """Return the blur with length, deviation and direction of the photograph's smear; as it is if smooth.

    Medians over the cells, each weighed by how well it knows its length, ``1 / (c^2 + (sigma / (length + 2
    px))^2)``, and by the probability ``of_kind`` (h, w), by default 1.
    """
    smears, sigma = grid.smears(), grid.sigma_px
    seen = sigma < UNSEEN_PX
    if seen.mean() < MIN_KNOWN:
        return blur
    weight = seen / (KNOWN_BEST**2 + (sigma / (smears.length_px + SHORTEST_PX)) ** 2).astype(float)
    if grid.kinds is not None:
        weight = weight * (1 - grid.kinds[..., CANNOT_TELL])
    weight = weight if of_kind is None else weight * of_kind
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
