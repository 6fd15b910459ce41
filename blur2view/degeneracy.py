"""Which model the smears pay for: no parallax (rotation or plane), parallax and so an F, or several motions.

A homography alone and a homography with parallax are nested, and compared by a penalised likelihood on one
noise scale (`parallax`). Where a homography leaves errors that are independent of each other, nothing is
left to explain: the smears show a rotation or a plane, and there is no F. Where it leaves errors that
neighbours share, they may be parallax or errors of the smears: then lengths may err by more than directions,
and smears count for as many as are independent. If parallax is not proven so, F is given with the homography
beside it: open, where errors are of the size that the smears' standard deviations state; assumed, where they
are far smaller, as with a network whose sigma is several times its error, for then the noise is not known,
and photographs mostly show parallax.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from blur2view.epipolar import TINY, Array
from blur2view.estimators import SmearProblem, coherent_residuals
from blur2view.families import Fit, fit_best, richer_starts
from blur2view.homography import PlanarEnds, PlaneH, RotationH, refine_homography
from blur2view.homography_search import find_plane
from blur2view.matches import SmearMatches
from blur2view.motions import TwoMotions, find_two_motions, independence, suspicious
from blur2view.parallax import Evidence, deviations, parallax_evidence, planar_log_likelihood
from blur2view.plane_parallax import plane_and_parallax
from blur2view.refine import RefineOptions
from blur2view.search import EstimatorOptions

SAMPLE = 400  # smears that the homography is searched in, and that network errors are judged by
WHITE = 0.5  # share of independent errors from which a homography leaves nothing to explain
NEARLY_WHITE = 0.35  # the same for an F, whose fit is softer; 0.25 at most for network-like errors
LEAST_ON_PLANE = 0.4  # share of the smears without which no homography is reported
NO_GAIN = 30.0  # twice the log-likelihood below which independent errors show no parallax
GAIN, GAIN_PER_SMEAR = 40.0, 0.01  # and from which they prove it; between the two it is open
STATED = 0.3  # errors over standard deviations from which these are believed; 0.1 to 0.25 on real photographs
PROVEN = 30.0  # and among errors that are alike, smears counted as independent
UNDECIDED = 10.0  # within this of what a plane must gain over a rotation, it may be either
LEAST_BALANCE = 0.22  # a smaller second motion is an object, not the camera's
LEAST_GAIN = 80.0  # twice the log-likelihood of 700 smears that two motions must have over one
LEAST_WIDTH = 0.01  # spread of the midpoints across over along the line that fits them
REFINEMENT = 10  # Levenberg-Marquardt steps
PLANE_PARAMETERS, ROTATION_PARAMETERS = 8, 3
MEDIAN_SQUARED = 1.386  # median of the squared length of a standard normal pair


class Structure(StrEnum):
    """What the smears show."""

    STILL = "no motion"
    PARALLAX = "parallax"
    OPEN = "parallax or none"
    ASSUMED = "parallax, not proven"
    ROTATION = "rotation"
    PLANE = "plane"
    ROTATION_OR_PLANE = "rotation or plane"
    SEVERAL = "several motions"
    NOTHING = "nothing"


WITHOUT_F = {
    Structure.NOTHING,
    Structure.STILL,
    Structure.ROTATION,
    Structure.PLANE,
    Structure.ROTATION_OR_PLANE,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Verdict:
    """What the smears show, why, and the models that say so.

    ``fit`` is the F (of normalised coordinates) to report where there is one, ``A`` the generator of the
    homography; ``scores`` names and penalised costs of the homographies, comparable to those of the
    families of F.
    """

    structure: Structure
    sentence: str
    fit: Fit
    A: Array | None = None
    motions: TwoMotions | None = None
    scores: tuple[tuple[str, float], ...] = ()

    @property
    def F(self) -> Array | None:
        """F of normalised coordinates, None where there is none."""
        if self.structure in WITHOUT_F:
            return None
        return self.fit.point.matrix() if self.motions is None else self.motions.F[0]

    @property
    def model(self) -> str:
        """Name of the family that F is from, or of the homography."""
        if self.structure in WITHOUT_F:
            return str(self.structure)
        return self.fit.name if self.motions is None else "general"


def assess(
    matches: SmearMatches,
    problem: SmearProblem,
    fit: Fit,
    options: EstimatorOptions,
    rng: np.random.Generator,
    doubt: bool = False,
) -> Verdict:
    """Say what the smears show, given the best F.

    Parameters
    ----------
    matches : SmearMatches
    problem : SmearProblem
        The same smears, with standard deviations rescaled to what is met.
    fit : Fit
        The cheapest family of F.
    options : EstimatorOptions
    rng : numpy.random.Generator
    doubt : bool
        Whether F explains hardly more than chance: then only a homography is considered.
    """
    cutoff = options.cutoff
    sample = rng.permutation(len(matches))[:SAMPLE]
    part = planar_ends(problem, sample)
    plane = find_plane(part, cutoff, problem.camera_known, rng)
    if plane is None:
        return Verdict(structure=Structure.PARALLAX, sentence="no homography fits", fit=fit)
    if whiteness(part, plane.generator(), cutoff) >= WHITE:
        verdict = without_parallax(problem, fit, plane, cutoff, rng)
        if verdict is not None:
            return verdict
    if doubt:
        return Verdict(structure=Structure.NOTHING, sentence="no consensus", fit=fit)
    stated_px = np.maximum(0.5 * matches.sigma_px, options.min_sigma_px)
    if suspicious(problem, fit.point.matrix(), stated_px, cutoff):
        motions = find_two_motions(problem, fit.point.matrix(), stated_px, cutoff, rng)
        if motions is not None and motions.gain >= LEAST_GAIN:
            if motions.balance >= LEAST_BALANCE:
                return several_motions(problem, fit, motions)
            fit = cheaper(problem, fit, motions.F[0], cutoff)  # one motion, but perhaps a better F of it
    verdict = among_alike(matches, problem, fit, plane, sample)
    if verdict.structure is Structure.PARALLAX:
        return verdict
    if independent_errors(problem, fit, cutoff):
        return among_independent(problem, verdict, plane)
    believed = float(np.median(problem.sigma_px / stated_px)) >= STATED
    return verdict if believed else replace(verdict, structure=Structure.ASSUMED)


def collinear(matches: SmearMatches) -> str | None:
    """Reason if the midpoints lie along one line, which leaves F and H undetermined, or None."""
    middle = matches.midpoint - matches.midpoint.mean(axis=0)
    long, short = np.linalg.svd(middle, compute_uv=False) if len(middle) > 1 else (0.0, 0.0)
    if short > LEAST_WIDTH * long:
        return None
    return (
        f"all smears lie along one line: their midpoints are spread {short / max(long, TINY):.1%} across it"
    )


def planar_ends(problem: SmearProblem, index: NDArray[np.int_] | slice = slice(None)) -> PlanarEnds:
    """Smears of a problem as `homography` wants them."""
    return PlanarEnds(ends=problem.ends[index], sigma=problem.sigma_px[index] / problem.unit_px)


def whiteness(matches: PlanarEnds, A: Array, cutoff: float) -> float:
    """Share of independent deviations from a homography (`motions.independence`), outliers left out."""
    forward, backward = matches.residuals(A) / matches.sigma  # (2, N) each
    ahead = (forward**2).sum(axis=0) <= (backward**2).sum(axis=0)
    deviation = np.where(ahead, forward, backward)
    squared = (deviation**2).sum(axis=0)
    near = squared < cutoff**2 * float(np.median(squared)) / MEDIAN_SQUARED
    return independence(deviation, near, matches.ends.mean(axis=1))


def without_parallax(
    problem: SmearProblem, fit: Fit, plane: PlaneH, cutoff: float, rng: np.random.Generator
) -> Verdict | None:
    """Name a rotation or plane, or prove parallax beside one; None if a homography leaves too much."""
    every = planar_ends(problem)
    plane, _ = refine_homography(plane, every, RefineOptions(max_iterations=REFINEMENT, cutoff=cutoff))
    A = plane.generator()
    if whiteness(every, A, cutoff) < WHITE:
        return None
    evidence = parallax_evidence(deviations(A, fit.point.matrix(), every, problem.unit_px))
    if evidence.on_plane < LEAST_ON_PLANE:
        return None
    log_likelihood = planar_log_likelihood(A, every, problem.unit_px)
    gain = 2 * (log_likelihood - planar_log_likelihood(np.zeros((3, 3)), every, problem.unit_px))
    if gain < PLANE_PARAMETERS * np.log(len(problem.ends)):
        sentence = f"{evidence.on_plane:.0%} of {len(problem.ends)} smears are no longer than their errors"
        return Verdict(structure=Structure.STILL, sentence=sentence, fit=fit)
    fit, evidence = recovered(problem, fit, evidence, A, cutoff, rng)
    needed = gain_needed(len(problem.ends))
    figures = (
        f"one homography explains {evidence.on_plane:.0%} of {len(problem.ends)} smears, "
        f"parallax gains {evidence.gain:.0f} ({needed:.0f} needed)"
    )
    scores = (("plane", fit.score + evidence.gain - needed),)
    if evidence.gain >= NO_GAIN:
        return judged(evidence.gain, needed, fit, plane)
    return name_homography(problem, fit, plane, cutoff, figures, scores)


def gain_needed(count: int) -> float:
    """Gain from which parallax is proven among independent errors of ``count`` smears.

    Over 32 synthetic rotations and planes it is at most 28, over 16 general scenes at least 62.
    """
    return GAIN + GAIN_PER_SMEAR * count


def recovered(
    problem: SmearProblem, fit: Fit, evidence: Evidence, A: Array, cutoff: float, rng: np.random.Generator
) -> tuple[Fit, Evidence]:
    """Give the F that the plane and the smears off it say, with its evidence, where it is better than F."""
    every = planar_ends(problem)
    off_plane = np.flatnonzero(every.ordered(A).least ** 2 >= cutoff**2)
    F = plane_and_parallax(A, problem, off_plane, cutoff, rng)
    if F is None:
        return fit, evidence
    name, points = richer_starts(problem, [F])
    other = fit_best(name, points, problem, cutoff)
    found = parallax_evidence(deviations(A, other.point.matrix(), every, problem.unit_px))
    return (other, found) if found.gain > evidence.gain else (fit, evidence)


def name_homography(
    problem: SmearProblem,
    fit: Fit,
    plane: PlaneH,
    cutoff: float,
    figures: str,
    scores: tuple[tuple[str, float], ...],
) -> Verdict:
    """Tell a rotation from a plane: Schwarz's criterion for K R K^-1 against any homography."""
    either = Structure.ROTATION_OR_PLANE
    if not problem.camera_known:
        figures += "; without an image size a rotation cannot be told from a plane"
        return Verdict(structure=either, sentence=figures, fit=fit, A=plane.generator(), scores=scores)
    every, options = planar_ends(problem), RefineOptions(max_iterations=REFINEMENT, cutoff=cutoff)
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
        sentence=f"{figures}; a plane gains {gain:.0f} over a rotation ({needed:.0f} needed)",
        fit=fit,
        A=(rotation if structure is Structure.ROTATION else plane).generator(),
        scores=(*scores, ("rotation", scores[0][1] + gain - needed)),
    )


def several_motions(problem: SmearProblem, fit: Fit, motions: TwoMotions) -> Verdict:
    """Name several motions."""
    sentence = (
        f"{motions.first:.0%} and {motions.second:.0%} of {len(problem.ends)} smears follow two motions, "
        f"{motions.single:.0%} the best single one"
    )
    return Verdict(structure=Structure.SEVERAL, sentence=sentence, fit=fit, motions=motions)


def cheaper(problem: SmearProblem, fit: Fit, F: Array, cutoff: float) -> Fit:
    """Give the cheaper of a fit and of the richest plausible family refined from F (3, 3)."""
    name, points = richer_starts(problem, [F])
    other = fit_best(name, points, problem, cutoff)
    return other if other.score < fit.score else fit


def among_alike(
    matches: SmearMatches, problem: SmearProblem, fit: Fit, plane: PlaneH, sample: NDArray[np.int_]
) -> Verdict:
    """Judge parallax among errors that are alike: the gain counts for as many smears as are independent."""
    found = deviations(plane.generator(), fit.point.matrix(), planar_ends(problem, sample), problem.unit_px)
    evidence = parallax_evidence(found, 0.5**0.5 * matches.sigma_px[sample])
    return judged(evidence.gain * problem.independent / len(sample), PROVEN, fit, plane)


def independent_errors(problem: SmearProblem, fit: Fit, cutoff: float) -> bool:
    """Whether neighbours do not share the errors that F leaves, outliers left out."""
    residual = coherent_residuals(problem, fit.point.matrix())
    near = np.abs(residual) < cutoff
    return independence(residual[None], near, problem.ends.mean(axis=1)) >= NEARLY_WHITE


def among_independent(problem: SmearProblem, verdict: Verdict, plane: PlaneH) -> Verdict:
    """Judge parallax anew where F leaves independent errors: then every smear counts."""
    found = deviations(plane.generator(), verdict.fit.point.matrix(), planar_ends(problem), problem.unit_px)
    return judged(parallax_evidence(found).gain, gain_needed(len(problem.ends)), verdict.fit, plane)


def judged(gain: float, needed: float, fit: Fit, plane: PlaneH) -> Verdict:
    """Parallax is proven, or remains open."""
    figures = f"parallax gains {gain:.0f} over one homography ({needed:.0f} needed)"
    scores = (("plane", fit.score + gain - needed),)
    if gain >= needed:
        return Verdict(structure=Structure.PARALLAX, sentence=figures, fit=fit, scores=scores)
    A = plane.generator()
    return Verdict(structure=Structure.OPEN, sentence=figures, fit=fit, A=A, scores=scores)
