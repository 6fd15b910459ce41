"""Whether one homography leaves nothing to explain, and whether it is a rotation's or a plane's.

Where the deviations of the smears from a homography are independent of each other there is no parallax left
in them, unless some smears lie off the homography along epipolar lines (`parallax`).
"""

from __future__ import annotations

import numpy as np

from blur2view.arrays import Array
from blur2view.geometry.two_view_geometry import MotionModel
from blur2view.robust.homography import (
    PlaneH,
    RotationH,
    refine_homography,
    transfer_orders,
    transfer_residuals,
)
from blur2view.robust.independence import independence
from blur2view.robust.problem import SmearProblem
from blur2view.robust.residuals import RefineOptions, WeightedEnds
from blur2view.two_view.model_selection import Fit, fit_best, richer_starts
from blur2view.two_view.parallax import Evidence, deviations, parallax_evidence, planar_log_likelihood
from blur2view.two_view.plane_parallax import plane_and_parallax
from blur2view.two_view.verdict import Structure, Verdict

WHITE = 0.5  # share of independent errors from which a homography leaves nothing to explain
LEAST_ON_PLANE = 0.4  # share of the smears without which no homography is reported
NO_GAIN = 30.0  # twice the log-likelihood below which independent errors show no parallax
GAIN, GAIN_PER_SMEAR = 40.0, 0.01  # and from which they prove it; between the two it is open
CLEARLY = 10.0  # gain over the search's F that an F through the plane must have: it is the best of many
UNDECIDED = 10.0  # within this of what a plane must gain over a rotation, it may be either
REFINEMENT = 10  # Levenberg-Marquardt steps
PLANE_PARAMETERS, ROTATION_PARAMETERS = 8, 3
MEDIAN_SQUARED = 1.386  # median of the squared length of a standard normal pair


def whiteness(matches: WeightedEnds, A: Array, cutoff: float) -> float:
    """Return the share of independent deviations from a homography (`independence`), outliers left out."""
    forward, backward = transfer_residuals(A, matches) / matches.sigma  # (2, N) each
    ahead = (forward**2).sum(axis=0) <= (backward**2).sum(axis=0)
    deviation = np.where(ahead, forward, backward)
    squared = (deviation**2).sum(axis=0)
    near = squared < cutoff**2 * float(np.median(squared)) / MEDIAN_SQUARED
    return independence(deviation, near, matches.ends.mean(axis=1))


def without_parallax(
    problem: SmearProblem, fit: Fit, plane: PlaneH, cutoff: float, rng: np.random.Generator
) -> Verdict | None:
    """Return a rotation, a plane, or proven parallax beside one; None if a homography leaves too much."""
    every = problem.weighted
    plane, _ = refine_homography(plane, every, RefineOptions(max_iterations=REFINEMENT, cutoff=cutoff))
    A = plane.generator()
    if whiteness(every, A, cutoff) < WHITE:
        return None
    evidence = parallax_evidence(deviations(A, fit.point.matrix(), every, problem.unit_px))
    if evidence.on_plane < LEAST_ON_PLANE:
        return None
    better, evidence = recovered(problem, fit, evidence, A, cutoff, rng)
    needed = gain_needed(len(problem.ends))
    if evidence.gain >= NO_GAIN:
        return judged(evidence.gain, needed, better, plane)
    figures = (
        f"one homography explains {evidence.on_plane:.0%} of {len(problem.ends)} smears, "
        f"parallax gains {evidence.gain:z.0f} ({needed:.0f} needed)"
    )
    scores = ((MotionModel.PLANE, fit.score + evidence.gain - needed),)
    return name_homography(problem, fit, plane, cutoff, figures, scores)


def gain_needed(count: int) -> float:
    """Return the gain from which parallax is proven among independent errors of ``count`` smears.

    Of 100 synthetic rotations and 100 planes three gain 30 to 39 and none more; of 60 general scenes and 60
    pure translations one gains 127, all others 300 and more.
    """
    return GAIN + GAIN_PER_SMEAR * count


def recovered(
    problem: SmearProblem, fit: Fit, evidence: Evidence, A: Array, cutoff: float, rng: np.random.Generator
) -> tuple[Fit, Evidence]:
    """Return F from the plane and the smears off it, with its evidence, where it is clearly better."""
    every = problem.weighted
    off_plane = np.flatnonzero(transfer_orders(A, every).least ** 2 >= cutoff**2)
    F = plane_and_parallax(A, problem, off_plane, cutoff, rng)
    if F is None:
        return fit, evidence
    model, points = richer_starts(problem, [F])
    other = fit_best(model, points, problem, cutoff)
    new = parallax_evidence(deviations(A, other.point.matrix(), every, problem.unit_px))
    return (other, new) if new.gain > evidence.gain + CLEARLY else (fit, evidence)


def name_homography(
    problem: SmearProblem,
    fit: Fit,
    plane: PlaneH,
    cutoff: float,
    figures: str,
    scores: tuple[tuple[MotionModel, float], ...],
) -> Verdict:
    """Return whether it is a rotation or a plane: Schwarz's criterion for K R K^-1 against any homography."""
    either = Structure.ROTATION_OR_PLANE
    if not problem.has_camera:
        figures += "; without an image size a rotation cannot be distinguished from a plane"
        return Verdict(structure=either, sentence=figures, fit=fit, A=plane.generator(), scores=scores)
    every, options = problem.weighted, RefineOptions(max_iterations=REFINEMENT, cutoff=cutoff)
    rotation, _ = refine_homography(
        RotationH.from_generator(plane.generator(), problem.prior), every, options
    )
    prior, _ = rotation.prior()
    likelihood = [planar_log_likelihood(h.generator(), every, problem.unit_px) for h in (plane, rotation)]
    gain = 2 * (likelihood[0] - likelihood[1]) + float(prior @ prior)
    needed = (PLANE_PARAMETERS - ROTATION_PARAMETERS) * float(np.log(len(problem.ends)))
    structure = Structure.PLANE if gain > needed else Structure.ROTATION
    structure = either if abs(gain - needed) < UNDECIDED else structure
    return Verdict(
        structure=structure,
        sentence=f"{figures}; a plane gains {gain:z.0f} over a rotation ({needed:.0f} needed)",
        fit=fit,
        A=(rotation if structure is Structure.ROTATION else plane).generator(),
        scores=(*scores, (MotionModel.ROTATION, scores[0][1] + gain - needed)),
    )


def judged(gain: float, needed: float, fit: Fit, plane: PlaneH) -> Verdict:
    """Return that parallax is proven, or remains open."""
    scores = ((MotionModel.PLANE, fit.score + gain - needed),)
    figures = f"gains {gain:z.0f} over one homography ({needed:.0f} needed)"
    if gain >= needed:
        return Verdict(
            structure=Structure.PARALLAX, sentence=f"parallax is proven: it {figures}", fit=fit, scores=scores
        )
    sentence = f"parallax is open: it {figures}"
    A = plane.generator()
    return Verdict(structure=Structure.OPEN, sentence=sentence, fit=fit, A=A, scores=scores)
