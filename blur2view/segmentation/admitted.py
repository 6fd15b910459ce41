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
    """Return the least score and reach (`motion_score`) of every cell against several motions.

    Errors are believed to be as large as stated, or as the first motion shows: another that explains less
    explains no mover either. Both are zero if one of the motions is neither an F nor a homography.
    """
    first, *others = motions
    own = motion_score(replace(found, geometry=first))
    believed = max(own.error_scale, 1.0)
    scored = [own, *(motion_score(replace(found, geometry=one), believed) for one in others)]
    known = all(motion.F is not None or motion.H is not None for motion in motions)
    return replace(
        own,
        score=known * np.min([one.score for one in scored], axis=0),
        reach=known * np.min([one.reach for one in scored], axis=0),
        reason=own.reason
        if known
        else "nothing to measure against: half of the picture knows no motion of the camera",
    )
