"""What the smears show that are sure of themselves, wherever in the picture: parallax, a rotation or a plane.

F is estimated from the surest smears, and most of those lie on what fills the picture: of rendered scenes
whose parallax is a fifth to a half of the smears (`tools.datasets.motion_kinds`), they show 2 to 18 %. So
parallax is judged by all smears that are sure to a share of their length (`sampling.SURE_SHARE`), spread
evenly, and by what a homography leaves of them in proportion to their length: standard deviations grow where
depths meet, which is where parallax is seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.robust.homography import Homographies, RotationH, refine_homography, transfer_orders
from blur2view.robust.homography_search import find_plane
from blur2view.robust.parametrization import CameraPrior
from blur2view.robust.problem import SmearProblem
from blur2view.robust.residuals import RefineOptions, WeightedEnds
from blur2view.two_view.model_selection import Fit
from blur2view.two_view.verdict import Structure, Verdict

LEAST = 100  # sure smears without which nothing is judged by them: a twentieth of the picture
SEARCHED = 500  # of them that the homography is searched in
ERROR = 0.05  # their common standard deviation, over their length
# Deviation from a homography, over the length, from which it is parallax: a fifth more than the greatest of
# 29 development rotations and planes, 0.055. Without that margin (0.058) 3 of 60 held-out ones were proven.
PROVEN_SHARE = 0.066
EXPLAINED = 0.67  # most of it that F may leave
# F leaves more than this of any network's smears (of 39 development photographs at least 0.0058); of better
# ones a smaller deviation from a homography is parallax, if it is many times what F leaves and more than a
# lens makes of a rotation (0.021 with -0.25 r^2, r over the longer side), if the lens is not known.
EXACT, EXACT_SHARE, EXACT_RATIO = 0.004, 0.035, 6.0
KNOWN_LENS_SHARE = 0.01
# A rotation is named where its deviations are at most this times those of any homography: of 16 development
# rotations 12 had 1.31 and less, of 13 planes all had 1.37 and more.
ROTATION_RATIO = 1.36
STEPS = 10  # Levenberg-Marquardt steps


@dataclass(frozen=True, kw_only=True)
class SureSmears:
    """Mean deviations of sure smears from models, over their mean length, and the homography's generator.

    ``plane``, ``rotation`` (None without a camera) and ``epipolar`` are those from the best homography, the
    best rotation, and the epipolar lines of F; ``A`` (3, 3) is of the homography that is named;
    ``lens_known`` whether the camera's intrinsics are.
    """

    plane: float
    rotation: float | None
    epipolar: float
    A: Array
    lens_known: bool = False

    @property
    def proven(self) -> bool:
        """Whether no homography explains the smears, and F does."""
        needed, allowed = self.limits
        return self.plane >= needed and self.epipolar <= allowed

    @property
    def limits(self) -> tuple[float, float]:
        """The least deviation from a homography that proves parallax, and the greatest from F."""
        if self.epipolar <= EXACT:
            share = KNOWN_LENS_SHARE if self.lens_known else EXACT_SHARE
            return max(share, EXACT_RATIO * self.epipolar), EXACT
        return PROVEN_SHARE, EXPLAINED * self.plane

    @property
    def structure(self) -> Structure:
        """What they show."""
        if self.proven:
            return Structure.PARALLAX
        if self.rotation is None:
            return Structure.OPEN
        return Structure.ROTATION_OPEN if turns(self.rotation, self.plane) else Structure.PLANE_OPEN

    def verdict(self, fit: Fit) -> Verdict:
        """Return the verdict, with the F of a fit."""
        needed, allowed = self.limits
        missed = f"sure smears miss one homography by {self.plane:.1%} of their length ({needed:.1%} needed)"
        if self.plane >= needed:
            missed += f", F by {self.epipolar:.1%} (at most {allowed:.1%})"
        if self.proven:
            sentence = f"parallax is proven: {missed}"
            return Verdict(structure=Structure.PARALLAX, sentence=sentence, fit=fit)
        sentence = f"parallax is open: {missed}"
        if self.rotation is not None:
            sentence += f", a rotation by {self.rotation:.1%}"
        return Verdict(structure=self.structure, sentence=sentence, fit=fit, A=self.A)


def turns(rotation: float, plane: float) -> bool:
    """Return whether deviations from a rotation are as good as equal to those from any homography."""
    return rotation <= ROTATION_RATIO * plane


def judge_sure(
    ends_px: Array, problem: SmearProblem, fit: Fit, cutoff: float, rng: np.random.Generator
) -> SureSmears | None:
    """Return what sure smears show; None if there are fewer than LEAST.

    Parameters
    ----------
    ends_px : ndarray of shape (M, 2, 2)
        Their ends, pixels.
    problem : SmearProblem
        That F was estimated in.
    fit : Fit
        F.
    cutoff : float
        Residual in standard deviations at which a smear counts as not explained.
    rng : numpy.random.Generator
    """
    if len(ends_px) < LEAST:
        return None
    ends = ends_px * np.diag(problem.T)[:2] + problem.T[:2, 2]
    length = np.maximum(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), TINY)
    every = WeightedEnds(ends=ends, sigma=ERROR * 0.5**0.5 * length)
    sample = rng.permutation(len(ends))[:SEARCHED]
    found = find_plane(
        replace(every, ends=ends[sample], sigma=every.sigma[sample]), cutoff, problem.has_camera, rng
    )
    if found is None:
        return None
    options = RefineOptions(max_iterations=STEPS, cutoff=cutoff)

    def missed(residual: Array) -> float:
        return float((np.abs(residual) * length).mean() / length.mean() * ERROR)

    def off(family: Homographies) -> float:
        return missed(transfer_orders(family.generator(), every).least)

    plane, _ = refine_homography(found, every, options)
    epipolar = missed(every.residuals(fit.point.matrix()).least)
    if not problem.has_camera:
        return SureSmears(plane=off(plane), rotation=None, epipolar=epipolar, A=plane.generator())
    # the lens is free even where it is known: errors that vary slowly over the picture look like another lens
    prior = CameraPrior(rotation=problem.prior.rotation)
    start = RotationH.from_generator(plane.generator(), prior)
    rotation, _ = refine_homography(start, every, options)
    named = rotation if turns(off(rotation), off(plane)) else plane
    return SureSmears(
        plane=off(plane),
        rotation=off(rotation),
        epipolar=epipolar,
        A=named.generator(),
        lens_known=problem.intrinsics_known,
    )
