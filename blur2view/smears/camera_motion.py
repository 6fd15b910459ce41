"""Did the camera move during the exposure, and so what blurred the photograph? Decided here alone.

Evidence comes from three sources, each dearer than the one before. The cells of a `SmearGrid` state kinds of
blur, which are averaged over the photograph; a cell that cannot tell counts less, and cells near the border
count more: before a camera at rest something moves within the picture, and a camera that follows something
blurs what is around it. Networks over the picture say what moves by itself and whether the camera moved
(`Movers`). The fit of a geometry says whether the smears may be errors of a camera that stood still.
`Evidence.needed` says which source is to be asked next, `Evidence.blur` weighs all that were.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

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

BORDER, BORDER_WEIGHT = 0.15, 3.0  # share of a side that is near the border; weight of its cells
MOVED = 0.5  # share that must be smeared for the camera to have moved
CLOSE_MOVED = 0.2  # difference of the smeared share from MOVED that is close
# Length of what is surely smeared, pixels and standard deviations; share of the cells that must be so.
SURE_PX, SURE_SIGMAS, SURE_SHARE = 3.0, 2.0, 0.01
# Share of the picture that must move, or of the cells that must be smeared, for anything to have moved.
MOVING_SHARE = 0.005
# A camera plainly moved if at most this share of the cells is not smeared, and the median smear this long.
MAX_STILL, PLAIN_PX = 0.1, 4.0
# Length of the camera's smooth motion over that of the smears, below which the smears may be errors of a
# camera at rest: 0.15 to 0.57 in pictures of cameras at rest, 0.65 to 1 in frames of moving ones.
MIN_CAMERA_SHARE = 0.6
IN_FOCUS = 0.2  # share of what is not smeared that must be sharp: the subject


class Needed(Enum):
    """What is still to be asked before a photograph's blur is named."""

    NOTHING = auto()
    WINDOWS = auto()  # all windows of the photograph: a cheap look leaves the name open
    MOVERS = auto()  # the networks over the picture: the cells leave open whether the camera moved


@dataclass(frozen=True, kw_only=True, eq=False)
class Movers:
    """What networks over a photograph say: what moves by itself, and whether the camera does."""

    cells: Array  # (h, w): the share of each cell of the grid that moves by itself
    share: float  # that of the picture
    camera_moved: float | None  # probability that the camera moved; None: the cells judge it
    camera_px: float = 0.0  # median displacement of the camera's smooth motion, pixels


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """All that is known when a photograph's blur is named; what was not asked is None."""

    grid: SmearGrid  # of a look at the photograph, in any stride; without kinds the camera is taken to move
    every_window: bool = True  # whether `grid` holds all that is read for the geometry: no cheap look
    nothing_seen: str = ""  # why the photograph shows nothing: `blur.nothing_seen`
    movers: Movers | None = None
    stood_still: bool = False  # whether the fit of a geometry says that the camera did not move

    @property
    def needed(self) -> Needed:
        """What is to be asked next."""
        if self.nothing_seen or self.movers is not None or self.grid.kinds is None:
            return Needed.NOTHING
        if self.every_window:
            return Needed.MOVERS if in_doubt(self.grid) else Needed.NOTHING
        return Needed.WINDOWS if in_doubt(self.grid) or is_close(self.grid) else Needed.NOTHING

    @property
    def surely_moved(self) -> bool:
        """Whether no geometry can say any more that the camera stood still."""
        seen, smear_px = self.movers, self.blur.smear_px or 0.0
        return self.grid.kinds is not None and (seen is None or seen.camera_px >= MIN_CAMERA_SHARE * smear_px)

    @property
    def blur(self) -> Blur:
        """The blur of the photograph."""
        grid, movers = self.grid, self.movers
        smeared = with_length(Blur(kind=BlurKind.CANNOT_TELL, nothing_seen=self.nothing_seen), grid)
        if self.nothing_seen or not knows_kinds(grid) or (grid.blur is None and smeared.smear_px is None):
            return smeared
        still = np.ones(grid.cells.shape[:2]) if movers is None else 1 - movers.cells
        moving_share = 0.0 if movers is None else movers.share
        if grid.blur is None or grid.kinds is None:
            kind = BlurKind.SHARP if self.stood_still else BlurKind.CAMERA_MOVED
            return with_length(Blur(kind=kind), grid)
        kinds = np.asarray(grid.kinds, float)
        decided = movers is not None and movers.camera_moved is not None
        moved = not self.stood_still and (decided or not smeared.is_short)
        kind = kind_of(kinds * still[..., None], moving_share, moved and self._camera_moved)
        in_focus = kind in (BlurKind.SHARP, BlurKind.CAMERA_AT_REST, BlurKind.CAMERA_MOVED)
        weight = kinds[..., [SHARP, SMEARED] if in_focus else [OUT_OF_FOCUS, BOTH]].sum(-1)
        radius, spread = weighted_median(grid.blur[..., 0], weight * (1 - kinds[..., CANNOT_TELL]))
        if kind is BlurKind.SHARP and radius > DEFOCUSED_PX:
            kind = BlurKind.OUT_OF_FOCUS
        blur = Blur(kind=kind, defocus_px=radius, defocus_sigma_px=spread, moving_share=moving_share)
        counted = [SMEARED, BOTH] if kind.of_camera else [SHARP, OUT_OF_FOCUS]
        return with_length(blur, grid, kinds[..., counted].sum(-1) * still)

    @property
    def _camera_moved(self) -> bool:
        """Whether cells and movers say that the camera moved."""
        if self.movers is not None and self.movers.camera_moved is not None:
            return self.movers.camera_moved > 0.5
        return smeared_share(self.grid) > MOVED


def blur_of(
    grid: SmearGrid,
    image: AnyArray | None = None,
    moving: AnyArray | None = None,
    camera_moved: float | None = None,
    moving_share: float | None = None,
) -> Blur:
    """Return the blur of a photograph, by the cells of its grid and what else is known.

    From an ``image`` it also takes why nothing can be seen. For a grid without kinds of blur the camera is
    taken to have moved. ``moving`` (h, w) is the share of each cell that moves by itself, by default 0;
    ``moving_share`` that of the picture, by default the mean of ``moving``; ``camera_moved`` the probability
    that the camera moved, by default judged by the kinds of the cells.
    """
    nothing, movers = "" if image is None else nothing_seen(image, grid), None
    if moving is not None or camera_moved is not None or moving_share is not None:
        cells = np.zeros(grid.cells.shape[:2]) if moving is None else np.asarray(moving, float)
        share = float(cells.mean()) if moving_share is None else moving_share
        movers = Movers(cells=cells, share=share, camera_moved=camera_moved)
    return Evidence(grid=grid, nothing_seen=nothing, movers=movers).blur


def kind_of(kinds: NDArray[np.float64], moving_share: float, camera_moved: bool) -> BlurKind:
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
    """Whether the decision is so near a limit that reading all windows may change it."""
    if grid.kinds is None:
        return False
    moved, smears = smeared_share(grid), grid.smears()
    if abs(moved - MOVED) < CLOSE_MOVED:
        return True
    if moved > MOVED:
        blur = Evidence(grid=grid).blur
        return blur.kind is BlurKind.CAMERA_MOVED and (blur.defocus_px or 0.0) > DEFOCUSED_PX
    sure = smears.length_px > np.maximum(SURE_PX, SURE_SIGMAS * grid.sigma_px)
    return bool((sure & (grid.kinds[..., [SMEARED, BOTH]].sum(-1) > 0.5)).mean() > SURE_SHARE)
