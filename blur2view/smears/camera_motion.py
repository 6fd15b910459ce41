"""Did the camera move during the exposure, and so what blurred the photograph? Decided here alone.

Evidence comes from three sources, each dearer than the one before. The cells of a `SmearGrid` state kinds of
blur, which are averaged over the photograph; a cell that cannot tell counts less, and cells near the border
count more: before a camera at rest something moves within the picture, and a camera that follows something
blurs what is around it. Networks over the picture say what moves by itself and whether the camera moved
(`Movers`). The fit of a geometry says whether the smears may be errors of a camera that stood still.
`Evidence.needed` says which source is to be asked next, `Evidence.blur` weighs all that were.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, auto
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, AnyArray, Array
from blur2view.smears.blur import (
    DEFOCUSED_PX,
    Blur,
    BlurKind,
    knows_kinds,
    nothing_seen,
    weighted_median,
    with_length,
)
from blur2view.smears.grid import SmearGrid
from blur2view.smears.likelihood import BOTH, CANNOT_TELL, OUT_OF_FOCUS, SHARP, SMEARED
from blur2view.smears.matches import SmearMatches

BORDER, BORDER_WEIGHT = 0.15, 3.0  # share of a side that is near the border; weight of its cells
CLOSE_MOVED = 0.2  # difference of the smeared share from one half that is close
# Share of the smeared cells that must be out of focus, too, for a large radius to be close: long smears are
# read in small octaves, whose pixels are large. On two rendered videos in focus, 1080p and 2160p, it is 0.007
# at most; 0.04 in the one of 66 pictures that all windows call out of focus and moved, and fewer do not.
CLOSE_BOTH = 0.02
# Log-odds that the camera moved: of the smeared share those of the cells, by this factor where they decide
# alone; else the sum of these, of the U-Net's and the logarithm of the smooth motion's length over
# `PLAIN_PX`, by these factors, less a constant. A logistic regression on 134 pictures whose cells leave it
# open (every second of sharp, soft and smeared photographs, layers, RedKitchen and the phone) has about
# these; on the other 120 it errs in 13, the U-Net and the length alone in 16, and of 6 above 0.8 all moved.
BY_CELLS_ALONE, BY_CELLS, BY_PICTURE, LESS = 1.5, 0.6, 0.8, 1.0
MOST_ODDS, PICTURE_ODDS, LENGTH_ODDS = 4.6, 6.0, 2.5  # largest log-odds of cells, U-Net and length: bounds
# Length of what is surely smeared, pixels and standard deviations; share of the cells that must be so.
SURE_PX, SURE_SIGMAS, SURE_SHARE = 3.0, 2.0, 0.01
# Share of the picture that must move, or of the cells that must be smeared, for anything to have moved.
MOVING_SHARE = 0.005
# A camera plainly moved if at most this share of the cells is not smeared, and the median smear this long.
MAX_STILL, PLAIN_PX = 0.1, 4.0
# The camera did not move if the median of the smears that a geometry is fitted to is shorter, pixels. Where
# all may be errors: the quantile that is looked at, and the share of them that are no outliers, at least.
MIN_MEDIAN_PX, SHORT_QUANTILE, INLIERS = 1.0, 0.35, 0.5
IN_FOCUS = 0.2  # share of what is not smeared that must be sharp: the subject


def has_moved(camera_moved: float) -> bool:
    """Whether a camera that moved with this probability is taken to have moved."""
    return camera_moved > 0.5


class Needed(Enum):
    """What is still to be asked before a photograph's blur is named."""

    NOTHING = auto()
    WINDOWS = auto()  # more windows of the photograph: a cheap look leaves the name open
    MOVERS = auto()  # the networks over the picture: the cells leave open whether the camera moved


@dataclass(frozen=True, kw_only=True, eq=False)
class Movers:
    """What networks over a photograph say: what moves by itself, and whether the camera does."""

    cells: Array  # (h, w): the share of each cell of the grid that moves by itself
    share: float  # that of the picture
    camera_moved: float | None  # probability that the camera moved; None: the cells judge it


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """All that is known when a photograph's blur is named; what was not asked is None."""

    grid: SmearGrid  # of a look at the photograph, in any stride; without kinds the camera is taken to move
    closest: bool = True  # whether `grid` is of the closest look that is had to name the blur
    nothing_seen: str = ""  # why the photograph shows nothing: `blur.nothing_seen`
    movers: Movers | None = None
    stood_still: bool = False  # whether the fit of a geometry says that the camera did not move

    @cached_property
    def needed(self) -> Needed:
        """What is to be asked next."""
        if self.nothing_seen or self.movers is not None or self.grid.kinds is None:
            return Needed.NOTHING
        if self.closest:
            return Needed.MOVERS if in_doubt(self.grid) else Needed.NOTHING
        return Needed.WINDOWS if in_doubt(self.grid) or is_close(self.grid, self.blur) else Needed.NOTHING

    @property
    def camera_moved(self) -> float:
        """The probability that the camera moved."""
        if self.stood_still:
            return 0.0
        if self.grid.kinds is None:
            return 1.0
        if self.movers is not None and self.movers.camera_moved is not None:
            return self.movers.camera_moved
        return probability(BY_CELLS_ALONE * cell_odds(self._still_kinds))

    @cached_property
    def blur(self) -> Blur:
        """The blur of the photograph.

        A camera whose smears are no longer than their errors is not said to have moved: nobody can tell.
        """
        grid, camera_moved = self.grid, self.camera_moved
        if self.nothing_seen:  # then the cells have read noise
            return Blur(kind=BlurKind.CANNOT_TELL, nothing_seen=self.nothing_seen)
        if grid.blur is None or grid.kinds is None or not knows_kinds(grid):
            unknown = with_length(Blur(kind=BlurKind.CANNOT_TELL), grid)
            if not knows_kinds(grid) or unknown.smear_px is None:
                return unknown
            kind = BlurKind.CAMERA_MOVED if has_moved(camera_moved) else BlurKind.SHARP
            return replace(unknown, kind=kind, camera_moved=camera_moved)
        kinds, still_kinds = np.asarray(grid.kinds, float), self._still_kinds
        moving_share = 0.0 if self.movers is None else self.movers.share
        kind = decide_kind(still_kinds, moving_share, has_moved(camera_moved))
        in_focus = kind in (BlurKind.SHARP, BlurKind.CAMERA_AT_REST, BlurKind.CAMERA_MOVED)
        weight = kinds[..., [SHARP, SMEARED] if in_focus else [OUT_OF_FOCUS, BOTH]].sum(-1)
        radius, spread = weighted_median(grid.blur[..., 0], weight * (1 - kinds[..., CANNOT_TELL]))
        if kind is BlurKind.SHARP and radius > DEFOCUSED_PX:
            kind = BlurKind.OUT_OF_FOCUS
        blur = Blur(kind=kind, defocus_px=radius, defocus_sigma_px=spread, moving_share=moving_share)
        shown = [SMEARED, BOTH] if kind.of_camera else [SHARP, OUT_OF_FOCUS]
        blur = with_length(replace(blur, camera_moved=camera_moved), grid, still_kinds[..., shown].sum(-1))
        if not (kind.of_camera and blur.is_short):
            return blur
        figures = (
            f"{blur.smear_px or 0.0:.1f} px, no longer than their errors of {blur.smear_sigma_px:.1f} px"
        )
        return replace(blur, kind=BlurKind.CANNOT_TELL, nothing_seen=f"smears of {figures}")

    def measured_on(self, grid: SmearGrid) -> Blur:
        """Return the blur, with the length of the smear in a grid of more windows if the camera moved."""
        blur = self.blur
        if grid is self.grid or grid.kinds is None or not blur.kind.of_camera:
            return blur
        weight = np.asarray(grid.kinds[..., [SMEARED, BOTH]].sum(-1), float)
        measured = with_length(blur, grid, weight)
        return blur if measured.is_short else measured

    @property
    def _still_kinds(self) -> NDArray[np.float64]:
        """Probabilities of the kinds (h, w, 5) times the share of the cell that does not move by itself."""
        kinds = np.asarray(self.grid.kinds, float)
        return kinds if self.movers is None else kinds * (1 - self.movers.cells[..., None])


def probability(log_odds: float) -> float:
    """Return the probability of log-odds."""
    return float(1 / (1 + np.exp(-log_odds)))


def cell_odds(kinds: NDArray[np.float64]) -> float:
    """Return the log-odds of the share of the cells that is smeared, given their kinds (h, w, 5)."""
    share = smeared_share(kinds)
    return float(np.clip(np.log(max(share, TINY) / max(1 - share, TINY)), -MOST_ODDS, MOST_ODDS))


def moved_probability(grid: SmearGrid, picture_odds: float, camera_px: float) -> float:
    """Return the probability that the camera moved, given all evidence before the geometry's.

    The grid must have kinds. ``picture_odds`` are the log-odds of the U-Net, ``camera_px`` is the median
    displacement of the smooth motion that explains most smears, pixels.
    """
    length = np.clip(np.log(max(camera_px, TINY) / PLAIN_PX), -LENGTH_ODDS, LENGTH_ODDS)
    picture = float(np.clip(picture_odds, -PICTURE_ODDS, PICTURE_ODDS) + length)
    return probability(BY_CELLS * cell_odds(np.asarray(grid.kinds, float)) + BY_PICTURE * picture - LESS)


def blur_of(
    grid: SmearGrid,
    image: AnyArray | None = None,
    moving: AnyArray | None = None,
    camera_moved: float | None = None,
    moving_share: float | None = None,
) -> Blur:
    """Return the blur of a photograph, by the cells of its grid and what else is known.

    Parameters
    ----------
    grid : SmearGrid
        Its smears, (h, w) cells. Without kinds of blur the camera is taken to have moved.
    image : ndarray of shape (H, W, 3) or (H, W), optional
        The photograph, which shows why nothing can be seen, if so.
    moving : ndarray of shape (h, w), optional
        Share of each cell that moves by itself, by default 0.
    camera_moved : float, optional
        Probability that the camera moved, by default judged by the kinds of the cells.
    moving_share : float, optional
        Share of the picture that moves by itself, by default the mean of ``moving``.

    Returns
    -------
    Blur
        Its kind, and the lengths of smear and defocus, pixels.

    Raises
    ------
    ValueError
        If the photograph has another size than the one of the grid.

    Examples
    --------
    >>> import blur2view
    >>> grid = blur2view.estimate("models/sample.jpg", geometry=False).grid
    >>> print(blur2view.blur_of(grid).kind)
    camera moved
    """
    if image is not None and np.shape(image)[:2] != grid.shape:
        raise ValueError(f"expected the photograph of the grid, {grid.shape}, got {np.shape(image)}")
    nothing, movers = "" if image is None else nothing_seen(image, grid), None
    if moving is not None or camera_moved is not None or moving_share is not None:
        cells = np.zeros(grid.cells.shape[:2]) if moving is None else np.asarray(moving, float)
        share = float(cells.mean()) if moving_share is None else moving_share
        movers = Movers(cells=cells, share=share, camera_moved=camera_moved)
    return Evidence(grid=grid, nothing_seen=nothing, movers=movers).blur


def decide_kind(kinds: NDArray[np.float64], moving_share: float, camera_moved: bool) -> BlurKind:
    """Return the kind of blur of a photograph whose camera moved, or did not, from those of its cells.

    ``kinds`` (h, w, 5) are their probabilities times the share of the cell that does not move by itself.
    """
    if camera_moved:
        _, _, smeared, both = near_border(kinds)
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


def smeared_share(kinds: NDArray[np.float64]) -> float:
    """Return the share of cells, of kinds (h, w, 5), that is smeared, near the border weighed 3 times."""
    sums = near_border(kinds)
    return float(sums[[SMEARED, BOTH]].sum() / max(sums.sum(), TINY))


def in_doubt(grid: SmearGrid) -> bool:
    """Whether the kinds of the cells do not decide if the camera moved: some are smeared, some are not."""
    if grid.kinds is None:
        return False
    smeared_part = (grid.kinds[..., [SMEARED, BOTH]].sum(-1) > 0.5).mean()
    still_share = (grid.kinds[..., [SHARP, OUT_OF_FOCUS]].sum(-1) > 0.5).mean()
    overall = with_length(Blur(kind=BlurKind.CANNOT_TELL), grid)
    is_plain = still_share <= MAX_STILL and (overall.smear_px or 0.0) >= PLAIN_PX and not overall.is_short
    return bool(smeared_part > MOVING_SHARE and not is_plain)


def is_close(grid: SmearGrid, blur: Blur) -> bool:
    """Whether the blur, by the cells alone, is so near a limit that reading all windows may change it."""
    if grid.kinds is None:
        return False
    kinds, smears = np.asarray(grid.kinds, float), grid.smears()
    moved_share = smeared_share(kinds)
    if abs(moved_share - 0.5) < CLOSE_MOVED:
        return True
    if moved_share > 0.5:
        _, _, smeared, both = near_border(kinds)
        soft = (blur.defocus_px or 0.0) > DEFOCUSED_PX and both > CLOSE_BOTH * (smeared + both)
        return blur.kind is BlurKind.CAMERA_MOVED and soft
    if blur.kind is BlurKind.OUT_OF_FOCUS and decide_kind(kinds, 0.0, False) is BlurKind.SHARP:
        return True  # by its radius alone: all windows call 3 of 22 such photographs sharp
    sure = smears.length_px > np.maximum(SURE_PX, SURE_SIGMAS * grid.sigma_px)
    return bool((sure & (grid.kinds[..., [SMEARED, BOTH]].sum(-1) > 0.5)).mean() > SURE_SHARE)


def too_short(matches: SmearMatches) -> bool:
    """Whether the median smear is so short that the camera stood still."""
    return float(np.median(matches.length_px)) < MIN_MEDIAN_PX


def within_errors(matches: SmearMatches) -> bool:
    """Whether the shorter smears are as short as errors alone, so that the camera stood still.

    Up to half of the smears may be outliers. The squared length over sigma^2 of a displacement that is an
    error of standard deviation sigma has the exponential distribution of mean 1.
    """
    ratio = (matches.length_px / matches.sigma_px) ** 2
    return bool(np.quantile(ratio, SHORT_QUANTILE) < -np.log(1 - SHORT_QUANTILE / INLIERS))
