"""Which model the smears pay for: no parallax (rotation or plane), parallax and so an F, or several motions.

A homography alone and a homography with parallax are nested, and compared by a penalised likelihood on one
noise scale (`parallax`). Where a homography leaves errors that are independent of each other, nothing is
left to explain: the smears show a rotation or a plane, and there is no F. Where it leaves errors that
neighbours share, they may be parallax or errors of the smears: then lengths may err by more than directions,
and smears count for as many as are independent. If parallax is not proven so, F is given with the homography
beside it: parallax is open.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.geometry.two_view_geometry import MotionModel
from blur2view.robust.homography import PlaneH, transfer_orders
from blur2view.robust.homography_search import find_plane
from blur2view.robust.problem import SmearProblem
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.model_selection import Fit, fit_best, richer_starts, with_measured_noise
from blur2view.two_view.multiple_motions import (
    ENOUGH,
    TwoMotions,
    find_two_motions,
    independent_share,
    suspicious,
)
from blur2view.two_view.options import EstimatorOptions
from blur2view.two_view.parallax import Evidence, deviations, parallax_evidence
from blur2view.two_view.planarity import WHITE, gain_needed, judged, whiteness, without_parallax
from blur2view.two_view.sure_smears import judge_sure
from blur2view.two_view.verdict import Structure, Verdict

SAMPLE = 400  # smears that the homography is searched in, and that network errors are judged by
NEARLY_WHITE = 0.35  # share of independent errors of an F, whose fit is soft; network-like ones have 0.25
# Gain that proves parallax among correlated errors, smears counted as independent. Of network smears of 25
# rotations and 24 planes (`failure_scenes`, seeds from 1000) the greatest were 20 and 12.
PROVEN = 25.0
LEAST_BALANCE = 0.22  # a smaller second motion is an object, not the camera's
LEAST_GAIN = 50.0  # of two motions over one, see `multiple_motions.TwoMotions`
MOSTLY = 0.82  # of what two motions explain, which one homography explains where there is but one
ATTEMPTS = 3  # of finding two motions


def assess(
    matches: SmearMatches,
    problem: SmearProblem,
    fits: list[Fit],
    options: EstimatorOptions,
    rng: np.random.Generator,
    doubt: bool = False,
) -> Verdict:
    """Return what the smears show, given every model of F that was fitted.

    Parameters
    ----------
    matches : SmearMatches
    problem : SmearProblem
        The same smears, with standard deviations rescaled to what is met.
    fits : list of Fit
    options : EstimatorOptions
    rng : numpy.random.Generator
    doubt : bool
        Whether the cheapest F explains hardly more than chance: then only a homography is considered.
    """
    cutoff, fit = options.cutoff, min(fits, key=lambda fit: fit.score)
    if doubt and within_errors(matches):
        sentence = "no motion, the smears are no longer than their errors"
        return Verdict(structure=Structure.STILL, sentence=sentence, fit=fit)
    sample = rng.permutation(len(matches))[:SAMPLE]
    part = problem.subset(sample).weighted
    plane = find_plane(part, cutoff, problem.has_camera, rng)
    if plane is None and not doubt:
        return Verdict(structure=Structure.PARALLAX, sentence="no homography fits", fit=fit)
    if plane is not None and whiteness(part, plane.generator(), cutoff) >= WHITE:
        verdict = without_parallax(problem, fit, plane, cutoff, rng)
        if verdict is not None and (verdict.F is None or not doubt):
            return verdict
    if doubt or plane is None:
        return Verdict(structure=Structure.NOTHING, sentence="no consensus", fit=fit)
    stated_px = np.maximum(0.5 * matches.sigma_px, options.min_sigma_px)
    evidence = tolerant_evidence(matches, problem, fit, plane, sample)
    backward, motions = swapped_by(problem, plane), None
    if evidence.on_plane <= MOSTLY:
        motions = motions_of(problem, fit, stated_px, backward, cutoff, rng)
    if motions is not None:
        if several(motions, evidence):
            return several_motions(len(problem.ends), motions, fit)
        fit = cheaper(problem, fit, motions.F[0], cutoff)  # one motion, but perhaps a better F of it
        evidence = tolerant_evidence(matches, problem, fit, plane, sample)
    if matches.sure_ends is not None:
        sure = judge_sure(matches.sure_ends, problem, fit, cutoff, rng)
        if sure is not None:
            return sure.verdict(fit)
    verdict = judged(evidence.gain * problem.independent / len(sample), PROVEN, fit, plane)
    if verdict.structure is Structure.PARALLAX or matches.sure_ends is not None:
        return verdict
    simplest = [f for f in fits if f.model is MotionModel.TRANSLATION]
    for family in (fit, *simplest):
        if independent_share(problem, family.point.matrix(), backward, cutoff) >= NEARLY_WHITE:
            return among_independent(problem, fit, family, plane)
    return verdict


def within_errors(matches: SmearMatches) -> bool:
    """Return whether the shorter smears are as short as errors alone make them, up to half astray.

    Of displacements that are errors of standard deviation sigma, the squared length over sigma^2 is
    distributed exponentially with mean 1.
    """
    ratio = (matches.length_px / matches.sigma_px) ** 2
    return bool(np.quantile(ratio, 0.35) < -np.log(1 - 0.35 / 0.5))


def swapped_by(problem: SmearProblem, plane: PlaneH) -> NDArray[np.bool_]:
    """Return where ends[:, 1] is the open end under a homography, (N,)."""
    ordered = transfer_orders(plane.generator(), problem.weighted)
    return np.abs(ordered.backward) < np.abs(ordered.forward)


def motions_of(
    problem: SmearProblem,
    fit: Fit,
    stated_px: Array,
    backward: NDArray[np.bool_],
    cutoff: float,
    rng: np.random.Generator,
) -> TwoMotions | None:
    """Return two motions that explain much more than one, or one F that does; None if neither does."""
    F = fit.point.matrix()
    if not suspicious(problem, F, stated_px, backward, cutoff):
        return None
    for _ in range(ATTEMPTS):
        motions = find_two_motions(problem, F, stated_px, backward, cutoff, rng)
        if motions is None or motions.gain >= LEAST_GAIN or motions.second == 0:
            break
    return motions if motions is not None and motions.gain >= LEAST_GAIN else None


def several(motions: TwoMotions, evidence: Evidence) -> bool:
    """Return whether two motions are more than an object, than one F explains, and than one homography."""
    together = motions.first + motions.second
    one_homography = evidence.on_plane > MOSTLY * together
    return motions.balance >= LEAST_BALANCE and motions.single < ENOUGH and not one_homography


def several_motions(count: int, motions: TwoMotions, fit: Fit) -> Verdict:
    """Return the verdict of several motions; its F is the best single one.

    It follows the motion of most smears more closely than F of the smears of one motion do, for these are
    told apart by place: of 31 synthetic scenes with a second motion of 30 or 45 % F of the larger part had a
    median rho under 0.05 in 17, the single one in 21.
    """
    sentence = (
        f"{motions.first:.0%} and {motions.second:.0%} of {count} smears follow two motions, "
        f"{motions.single:.0%} the best single one"
    )
    return Verdict(structure=Structure.SEVERAL, sentence=sentence, fit=fit)


def cheaper(problem: SmearProblem, fit: Fit, F: Array, cutoff: float) -> Fit:
    """Return the cheaper of a fit and of the richest plausible family refined from F (3, 3).

    The standard deviations are those that the dearer one left: the cheaper is refined at its own.
    """
    model, points = richer_starts(problem, [F])
    other = fit_best(model, points, problem, cutoff)
    if other.score >= fit.score:
        return fit
    own = with_measured_noise(problem, other.point.matrix(), cutoff)
    return replace(other, point=fit_best(model, [other.point], own, cutoff).point)


def tolerant_evidence(
    matches: SmearMatches, problem: SmearProblem, fit: Fit, plane: PlaneH, sample: NDArray[np.int_]
) -> Evidence:
    """Return the evidence for parallax where lengths may err by more than directions, as sigma admits.

    Standard deviations are those given: residuals of F are smaller, for it takes up errors that neighbours
    share, but no homography takes up as many.
    """
    stated = problem.rescaled(1 / problem.scale).subset(sample)
    against = deviations(plane.generator(), fit.point.matrix(), stated.weighted, stated.unit_px)
    return parallax_evidence(against, 0.5**0.5 * matches.sigma_px[sample])


def among_independent(problem: SmearProblem, fit: Fit, white: Fit, plane: PlaneH) -> Verdict:
    """Return the verdict by a model of F that leaves independent errors: then every smear counts."""
    against = deviations(plane.generator(), white.point.matrix(), problem.weighted, problem.unit_px)
    return judged(parallax_evidence(against).gain, gain_needed(len(problem.ends)), fit, plane)
