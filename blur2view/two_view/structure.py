"""What the smears show: a rotation, a plane, parallax and so a translation and F, or several motions.

One test for every input. The homography alone and the homography with parallax along the epipolar lines of F
are nested, and so are a rotation and any homography: twice the gain in log-likelihood, with smears counted as
often as they are independent, decides. Where few smears are independent no gain does not mean no parallax:
then F is given with the homography beside it, and parallax is undecided.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.geometry.two_view_geometry import MotionModel
from blur2view.robust.homography import PlaneH, RotationH, transfer_orders
from blur2view.robust.homography_search import find_plane
from blur2view.robust.problem import TELLING, SmearProblem
from blur2view.robust.residuals import CUTOFF
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.flow import FlowData, fit_flow
from blur2view.two_view.model_selection import Fit, fit_best, richer_starts, with_measured_noise
from blur2view.two_view.multiple_motions import TwoMotions, find_two_motions
from blur2view.two_view.parallax import Evidence, deviations, parallax_evidence
from blur2view.two_view.plane_parallax import plane_and_parallax
from blur2view.two_view.verdict import Structure, Verdict

SAMPLE = 400  # smears that the tests look at, at most
# Gain that proves parallax. Of 138 rendered rotations and planes (`tools.datasets.motion_kinds`, seeds from
# 20000, 30000, 50000 and 60000; network smears) the largest gains are 33, 31 and 29; of 67 general motions 26
# gain 34 and more. Of 120 synthetic rotations and planes with independent errors one gains 16, the others 5.
PROVEN = 34.0
NO_GAIN = 0.75, 0.1  # of it, below which there is none: where neighbours err alike, and where none do
CLEARLY = 10.0  # gain over the search's F that an F through the plane must have: it is the best of many
LEAST_ON_PLANE = 0.4  # share of the smears without which no homography is reported
# Beyond Schwarz's criterion, what any homography must gain over a rotation: of 41 rendered rotations the
# gains reach 20, where the criterion asks for 17; of 34 planes 30 gain 27 and more.
MARGIN = 4.0
EXTRA = 5  # parameters of any homography beyond those of a rotation
SHORT = 0.35, 0.5  # quantile of the lengths, and share of smears that may be astray


@dataclass(frozen=True, kw_only=True, eq=False)
class Homographies:
    """The homography of most smears and, where a camera may be assumed, the rotation, on one noise.

    ``rotation_gain`` is what any homography gains over the rotation, ``needed`` what it must by Schwarz's
    criterion and a margin; no rotation without a camera.
    """

    plane: PlaneH
    rotation: RotationH | None
    rotation_gain: float
    needed: float

    @property
    def is_rotation(self) -> bool | None:
        """Whether a rotation explains the smears as well as any homography; None without a camera."""
        return None if self.rotation is None else self.rotation_gain < self.needed

    @property
    def generator(self) -> Array:
        """A (3, 3) of the homography that is reported."""
        if self.rotation is not None and self.is_rotation:
            return self.rotation.generator()
        return self.plane.generator()

    @property
    def sentence(self) -> str:
        """What any homography gains over a rotation."""
        if self.rotation is None:
            return "without an image size a rotation cannot be told from a plane"
        return f"any homography gains {self.rotation_gain:z.0f} over a rotation ({self.needed:.0f} needed)"


def assess(
    matches: SmearMatches,
    problem: SmearProblem,
    fits: list[Fit],
    rng: np.random.Generator,
    no_consensus: bool = False,
) -> Verdict:
    """Return what the smears show, given every model of F that was fitted.

    With ``no_consensus`` the F of least cost is hardly better than chance: only a homography is looked for.
    """
    fit = min(fits, key=lambda fit: fit.score)
    if no_consensus and within_errors(matches):
        sentence = "no motion, the smears are no longer than their errors"
        return Verdict(structure=Structure.STILL, sentence=sentence, fit=fit)
    sample = np.sort(rng.permutation(len(matches))[:SAMPLE])
    plane = find_plane(problem.subset(sample).weighted, problem.has_camera, rng)
    if plane is None:
        structure = Structure.NOTHING if no_consensus else Structure.PARALLAX
        return Verdict(structure=structure, sentence="no homography fits", fit=fit)
    evidence = evidence_of(matches, problem, fit, plane, sample)
    if not no_consensus:
        ordered, F = transfer_orders(plane.generator(), problem.weighted), fit.point.matrix()
        backward = np.abs(ordered.backward) < np.abs(ordered.forward)
        motions = find_two_motions(problem, F, backward, evidence.on_plane, matches.sampson_px, rng)
        if motions is not None and motions.are_several:
            return several_motions(len(matches), motions, fit)
        if motions is not None:
            fit = lower_cost(problem, fit, motions.F[0])  # one motion, but perhaps a better F of it
            evidence = evidence_of(matches, problem, fit, plane, sample)
        fit, evidence = recovered(matches, problem, fit, plane, evidence, sample, rng)
    count = problem.data_weight * len(sample)
    gain = problem.data_weight * evidence.gain
    figures = f"parallax gains {gain:z.0f} over one homography ({PROVEN:.0f} needed)"
    if not no_consensus and gain >= PROVEN:
        return Verdict(structure=Structure.PARALLAX, sentence=f"parallax is proven: {figures}", fit=fit)
    little = PROVEN * float(np.interp(problem.data_weight, (0, 1), NO_GAIN))
    absent = count >= TELLING and gain < little and evidence.on_plane >= LEAST_ON_PLANE
    if no_consensus and not absent:
        return Verdict(structure=Structure.NOTHING, sentence="no consensus", fit=fit)
    return without_parallax(matches, problem, fit, plane, sample, absent, figures)


def without_parallax(
    matches: SmearMatches,
    problem: SmearProblem,
    fit: Fit,
    plane: PlaneH,
    sample: NDArray[np.int_],
    absent: bool,
    figures: str,
) -> Verdict:
    """Return the verdict of a rotation, a plane, or either; F stays unless parallax is absent."""
    alternatives = no_parallax(matches, problem, plane, sample)
    names = {
        True: (Structure.ROTATION, Structure.ROTATION_UNDECIDED),
        False: (Structure.PLANE, Structure.PLANE_UNDECIDED),
        None: (Structure.ROTATION_OR_PLANE, Structure.UNDECIDED),
    }
    structure = names[alternatives.is_rotation][0 if absent else 1]
    prefix = "there is no parallax" if absent else "parallax is undecided"
    sentence = f"{prefix}: {figures}; {alternatives.sentence}"
    return Verdict(structure=structure, sentence=sentence, fit=fit, generator=alternatives.generator)


def no_parallax(
    matches: SmearMatches, problem: SmearProblem, plane: PlaneH, sample: NDArray[np.int_]
) -> Homographies:
    """Return the homography and the rotation that explain most smears, from a first homography."""
    part = matches.subset(sample)
    along, across = part.bulk_px
    data = FlowData.of(problem.subset(sample), (problem.noise_scale * along, problem.noise_scale * across))
    any_homography = fit_flow(plane, data)
    if not problem.has_camera:
        return Homographies(plane=any_homography.family, rotation=None, rotation_gain=0.0, needed=0.0)
    start = RotationH.from_generator(any_homography.family.generator(), problem.prior)
    rotation = fit_flow(start, data)
    return Homographies(
        plane=any_homography.family,
        rotation=rotation.family,
        rotation_gain=rotation.cost - any_homography.cost,
        needed=MARGIN + EXTRA * float(np.log(max(problem.data_weight * len(sample), np.e))),
    )


def evidence_of(
    matches: SmearMatches, problem: SmearProblem, fit: Fit, plane: PlaneH, sample: NDArray[np.int_]
) -> Evidence:
    """Return the evidence for parallax.

    Standard deviations are those stated: what F leaves is smaller where few smears are independent, for F
    takes up errors that neighbours share.
    """
    stated = problem.subset(sample).with_sigma(problem.noise_scale * matches.sampson_px[sample])
    return parallax_evidence(
        deviations(plane.generator(), fit.point.matrix(), stated.weighted, stated.unit_px)
    )


def within_errors(matches: SmearMatches) -> bool:
    """Return whether the shorter smears are as short as errors alone make them, up to half astray.

    Of displacements that are errors of standard deviation sigma, the squared length over sigma^2 is
    distributed exponentially with mean 1.
    """
    quantile, astray = SHORT
    ratio = (matches.length_px / matches.sigma_px) ** 2
    return bool(np.quantile(ratio, quantile) < -np.log(1 - quantile / astray))


def recovered(
    matches: SmearMatches,
    problem: SmearProblem,
    fit: Fit,
    plane: PlaneH,
    evidence: Evidence,
    sample: NDArray[np.int_],
    rng: np.random.Generator,
) -> tuple[Fit, Evidence]:
    """Return F from the plane and the smears off it, with its evidence, where it is clearly better."""
    off_plane = np.flatnonzero(transfer_orders(plane.generator(), problem.weighted).least ** 2 >= CUTOFF**2)
    F = plane_and_parallax(plane.generator(), problem, off_plane, rng)
    if F is None:
        return fit, evidence
    model, points = richer_starts(problem, [F])
    other = fit_best(model, points, problem)
    new = evidence_of(matches, problem, other, plane, sample)
    better = problem.data_weight * (new.gain - evidence.gain) > CLEARLY
    return (other, new) if better else (fit, evidence)


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


def lower_cost(problem: SmearProblem, fit: Fit, F: Array) -> Fit:
    """Return the fit of lower cost: one as given, or the richest plausible family refined from F (3, 3).

    Standard deviations are those that the given one left; the other, if better, is refined at its own.
    """
    model, points = richer_starts(problem, [F])
    other = fit_best(model, points, problem)
    if other.score >= fit.score:
        return fit
    own = with_measured_noise(problem, other.point.matrix())
    return fit_best(other.model, [other.point], own)


def models_of(fits: list[Fit], verdict: Verdict) -> tuple[tuple[MotionModel, float], ...]:
    """Return the penalised cost of every model of F, best first."""
    costs = {fit.model: fit.score for fit in [*fits, verdict.fit]}
    return tuple(sorted(costs.items(), key=lambda score: score[1]))
