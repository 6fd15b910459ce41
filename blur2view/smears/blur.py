"""What blurred a photograph, and by how much: `Blur`, from which its record and verdict are made.

A network states kinds of blur and radii of cells (:mod:`blur2view.smears.likelihood`). They are averaged over
the photograph; a cell that cannot tell counts less. Cells near the border count more: before a camera at rest
something moves within the picture, and a camera that follows something blurs what is around it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, AnyArray, Floats
from blur2view.smears.grid import SmearGrid, to_double_angle
from blur2view.smears.likelihood import BOTH, CANNOT_TELL, OUT_OF_FOCUS, SHARP, SHORTEST_PX, SMEARED

MIN_KNOWN = 0.04  # share of the cells of which the kind of blur must be known
BORDER, BORDER_WEIGHT = 0.15, 3.0  # share of a side that is near the border; weight of its cells
MOVED = 0.5  # share that must be smeared for the camera to have moved
CLOSE_MOVED = 0.2  # difference of the smeared share from MOVED that is close
# Length of what is surely smeared, pixels and standard deviations; share of the cells that must be so.
SURE_PX, SURE_SIGMAS, SURE_SHARE = 3.0, 2.0, 0.01
# Share of the picture that must move, or of the cells that must be smeared, for anything to have moved.
MOVING_SHARE = 0.005
# A camera plainly moved if at most this share of the cells is not smeared, and the median smear this long.
MAX_STILL, PLAIN_PX = 0.1, 4.0
IN_FOCUS = 0.2  # share of what is not smeared that must be sharp: the subject
DEFOCUSED_PX = 2.0  # radius, of what is sharpest, above which a photograph is out of focus
DARK, BRIGHT = 0.02, 0.98  # values below, or above, which a whole photograph is too dark, or overexposed
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
        return self in (BlurKind.CAMERA_MOVED, BlurKind.OUT_OF_FOCUS_AND_MOVED)


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
    nothing_seen: str = ""  # why nothing can be seen: too dark, overexposed, one colour

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

    def at_rest(self) -> Blur:
        """Return the blur with the kind that it has if the camera is known not to have moved."""
        if not self.kind.of_camera:
            return self
        if self.moving_share > MOVING_SHARE:
            return replace(self, kind=BlurKind.CAMERA_AT_REST)
        out_of_focus = self.kind is BlurKind.OUT_OF_FOCUS_AND_MOVED
        return replace(self, kind=BlurKind.OUT_OF_FOCUS if out_of_focus else BlurKind.SHARP)


def blur_of(
    grid: SmearGrid,
    image: AnyArray | None = None,
    moving: AnyArray | None = None,
    camera_moved: float | None = None,
    moving_share: float | None = None,
) -> Blur:
    """Return the blur of a photograph.

    From an ``image`` it also takes why nothing can be seen. For a grid without kinds of blur the camera is
    taken to have moved. ``moving`` (h, w) is the share of each cell that moves by itself, by default 0;
    ``moving_share`` that of the picture, by default the mean of ``moving``; ``camera_moved`` the probability
    that the camera moved, by default judged by the kinds of the cells.
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
    counted = [SHARP, SMEARED] if in_focus else [OUT_OF_FOCUS, BOTH]
    weight = kinds[..., counted].sum(-1) * known
    radius, spread = weighted_median(grid.blur[..., 0], weight)
    if kind is BlurKind.SHARP and radius > DEFOCUSED_PX:
        kind = BlurKind.OUT_OF_FOCUS
    blur = Blur(kind=kind, defocus_px=radius, defocus_sigma_px=spread, moving_share=moving_share)
    counted = [SMEARED, BOTH] if kind.of_camera else [SHARP, OUT_OF_FOCUS]
    return with_length(blur, grid, kinds[..., counted].sum(-1) * (1 - share))


def kind_of(kinds: NDArray[np.float64], moving_share: float, camera_moved: float | None = None) -> BlurKind:
    """Return the kind of blur of a photograph, from those of its cells.

    ``kinds`` (h, w, 5) are their probabilities times the share of the cell that does not move by itself.
    """
    sharp, defocused, smeared, both = near_border(kinds)
    moved, still = smeared + both, sharp + defocused
    has_moved = bool(moved > MOVED * (moved + still))
    if camera_moved is not None:
        has_moved = camera_moved > 0.5
    if has_moved:
        return BlurKind.OUT_OF_FOCUS_AND_MOVED if both > smeared else BlurKind.CAMERA_MOVED
    if moving_share > MOVING_SHARE:
        return BlurKind.CAMERA_AT_REST
    sharp, defocused = kinds.sum((0, 1))[:SMEARED]
    return BlurKind.OUT_OF_FOCUS if sharp <= IN_FOCUS * (sharp + defocused) else BlurKind.SHARP


def near_border(kinds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sums (4,) over the cells of all kinds but CANNOT_TELL, near the border weighed 3 times."""
    near = [np.minimum(np.arange(n), np.arange(n)[::-1]) < BORDER * n for n in kinds.shape[:2]]
    weight = np.where(near[0][:, None] | near[1], BORDER_WEIGHT, 1.0)
    return np.asarray((kinds * weight[..., None]).sum((0, 1))[:CANNOT_TELL])


def smeared_share(grid: SmearGrid) -> float:
    """Return the share of a grid that is smeared, cells near the border weighed 3 times.

    The grid must have kinds.
    """
    sums = near_border(np.asarray(grid.kinds, float))
    return float(sums[[SMEARED, BOTH]].sum() / max(sums.sum(), TINY))


def in_doubt(grid: SmearGrid) -> bool:
    """Whether the kinds of the cells do not decide if the camera moved: some are smeared, some are not."""
    if grid.kinds is None:
        return False
    smeared = (grid.kinds[..., [SMEARED, BOTH]].sum(-1) > 0.5).mean()
    still = (grid.kinds[..., [SHARP, OUT_OF_FOCUS]].sum(-1) > 0.5).mean()
    whole = with_length(Blur(kind=BlurKind.CANNOT_TELL), grid)
    is_plain = still <= MAX_STILL and (whole.smear_px or 0.0) >= PLAIN_PX and not whole.is_short
    return bool(smeared > MOVING_SHARE and not is_plain)


def is_close(grid: SmearGrid) -> bool:
    """Whether the decision is so near a limit that reading all windows may change it.

    True for 33 of 280 pictures by which no limit was chosen (sharp, soft, out of focus, smeared and of
    DAVIS); 13 of the others have another kind when all windows are read.
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
    """Return why a photograph (uint8, uint16 or 0 to 1) shows nothing, by its brightness; "" if it may."""
    white = np.iinfo(image.dtype).max if np.issubdtype(image.dtype, np.integer) else 1.0
    low, high = np.quantile(image[::4, ::4] / white, (0.02, 0.98))
    if high < DARK:
        return "too dark"
    if low > BRIGHT:
        return "overexposed"
    return "one colour all over, or transparent" if high - low < 1 / 255 else ""


def with_length(blur: Blur, grid: SmearGrid, of_kind: NDArray[np.float64] | None = None) -> Blur:
    """Return the blur with length, standard deviation and direction of the photograph's smear.

    Length and deviation are medians over the cells, weighed by ``1 / (c^2 + (sigma / (length + 2 px))^2)``,
    c KNOWN_BEST, and by the probability ``of_kind`` (h, w), by default 1. Without texture the blur stays as
    it is.
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
