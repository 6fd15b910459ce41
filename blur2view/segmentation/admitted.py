"""Which motions of the camera the smears admit: what moves must contradict all of them.

Neighbouring smears err alike, so the geometry is estimated again from half of the picture's blocks and from
the other half: no smear is judged only by a motion that was fitted to it. Where parallax is open, the
homography is another motion that the camera may have had.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.pipeline import Estimate
from blur2view.robust.independence import BLOCKS, cells
from blur2view.segmentation.score import MotionScore, motion_score
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.estimate import estimate_two_view
from blur2view.two_view.options import EstimatorOptions

# A motion's errors over those of the motion that explains most smears best. With 1.2, 1.5, 2 and any, masks
# of true smears have an IoU of 0.80, 0.77, 0.75 and 0.66 over all pixels of 48 development scenes; with 1.2
# one of 34 frames of RedKitchen has more than 1 % that moves.
MOST_SCALE = 1.5


def admitted_motions(
    found: Estimate, splits: int, options: EstimatorOptions, rng: np.random.Generator
) -> list[TwoViewGeometry]:
    """Return the estimate's geometry, its homography if there is an F, too, and geometries of halves.

    Parameters
    ----------
    found : Estimate
        With an F or a homography.
    splits : int
        How often the blocks of the picture are divided at random; each time gives two geometries.
    options : EstimatorOptions
    rng : numpy.random.Generator
    """
    geometry, matches = found.geometry, found.matches
    motions = [geometry]
    if geometry.F is not None and geometry.H is not None:
        motions.append(replace(geometry, F=None))
    sure = np.empty((0, 2, 2)) if matches.sure_ends is None else matches.sure_ends
    middle = np.concatenate([matches.midpoint, sure.mean(axis=1)])
    _, block = np.unique(cells(middle, BLOCKS), return_inverse=True)
    for _ in range(splits):
        half = (rng.permutation(block.max() + 1) % 2 == 0)[block]
        halves = (_part(matches, part) for part in (half, ~half))
        motions += [estimate_two_view(one, options, rng, found.camera) for one in halves]
    return motions


def _part(matches: SmearMatches, chosen: NDArray[np.bool_]) -> SmearMatches:
    """Return those chosen of the N matches and, after these, of the M ends of sure smears: (N + M,)."""
    used, sure = np.split(chosen, [len(matches)])
    part = matches.subset(used)
    return part if part.sure_ends is None else replace(part, sure_ends=part.sure_ends[sure])


def least_score(found: Estimate, motions: list[TwoViewGeometry]) -> MotionScore:
    """Return the least and the greatest score and the least reach of every cell against several motions.

    Motions that explain most smears much worse than the best one does are none that the camera may have had.
    Errors are as large as stated, or as the best motion shows. All is zero if one of the motions is neither
    an F nor a homography.
    """
    scored = [motion_score(replace(found, geometry=one)) for one in motions]
    if any(motion.F is None and motion.H is None for motion in motions):
        none = np.zeros_like(scored[0].score)
        reason = "nothing to measure against: half of the picture knows no motion of the camera"
        return replace(scored[0], score=none, reach=none, greatest=none, reason=reason)
    scale = min(one.error_scale for one in scored)
    scored = [one for one in scored if one.error_scale <= MOST_SCALE * scale]
    variance = max(scale, 1.0) ** 2
    return replace(
        scored[0],
        score=np.min([one.score for one in scored], axis=0) / variance,
        reach=np.min([one.reach for one in scored], axis=0) / variance,
        greatest=np.max([one.score for one in scored], axis=0) / variance,
        error_scale=scale,
    )
