"""Whether F is determined: what tells parallax from a rotation, a plane, or several motions.

One test for every input. The homography alone and the homography with parallax along the epipolar lines of F
are nested, and so are a rotation and any homography: twice the gain in log-likelihood, with smears counted as
often as they are independent, decides. Where few smears are independent no gain does not mean no parallax:
then F is given with the homography beside it, and parallax is undecided.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.geometry.two_view_geometry import Configuration, MotionModel
from blur2view.robust.homography import PlaneH, RotationH, transfer_orders
from blur2view.robust.homography_search import find_plane
from blur2view.robust.problem import LEAST_INDEPENDENT, SmearProblem
from blur2view.robust.residuals import CUTOFF
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.flow import FlowData, fit_flow
from blur2view.two_view.model_selection import Fit, fit_best, fit_from, with_measured_noise
from blur2view.two_view.multiple_motions import TwoMotions, find_two_motions
from blur2view.two_view.parallax import Evidence, parallax_evidence
from blur2view.two_view.plane_parallax import plane_and_parallax

SAMPLE = 400  # smears that the tests look at, at most
# Gain that proves parallax. Of 138 rendered rotations and planes (`tools.datasets.motion_kinds`, seeds from
# 20000, 30000, 50000 and 60000; network smears) the largest gains are 33, 31 and 29; of 67 general motions 26
# gain 34 and more. Of 120 synthetic rotations and planes with independent errors one gains 16, the others 5.
PROVEN = 34.0
NO_GAIN = 0.75, 0.1  # of it, below which there is none: where neighbours share errors, and where none do
CLEARLY = 10.0  # gain over the search's F that an F through the plane must have: it is the best of many
LEAST_ON_PLANE = 0.4  # share of the smears without which no homography is reported
# Beyond Schwarz's criterion, what any homography must gain over a rotation: of 41 rendered rotations the
# gains reach 20, where the criterion asks for 17; of 34 planes 30 gain 27 and more.
MARGIN = 4.0
EXTRA = 5  # parameters of any homography beyond those of a rotation
SHORT = 0.35, 0.5  # quantile of the lengths, and share of smears that may be outliers


HOMOGRAPHIES = {
    Configuration.PANORAMIC: MotionModel.ROTATION,
    Configuration.PLANAR: MotionModel.PLANE,
    Configuration.PLANAR_OR_PANORAMIC: MotionModel.ROTATION_OR_PLANE,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Assessment:
    """What the smears show, why, and the models behind it.

    ``fit`` is the F of least cost (of normalised coordinates), reported where ``trusted``; ``generator`` that
    of the homography, if one explains the smears.
    """

    config: Configuration
    sentence: str
    fit: Fit
    trusted: bool = False
    generator: Array | None = None

    @property
    def model(self) -> MotionModel:
        """Model of F or, without F, of the homography."""
        return self.fit.model if self.trusted else HOMOGRAPHIES.get(self.config, MotionModel.NONE)


def assess(
    matches: SmearMatches,
    problem: SmearProblem,
    fits: list[Fit],
    rng: np.random.Generator,
    no_consensus: bool = False,
) -> Assessment:
    """Return what the smears show, given every model of F that was fitted.

    With ``no_consensus`` the F of least cost is hardly better than chance: only a homography is looked for.
    """
    fit = min(fits, key=lambda fit: fit.score)
    if no_consensus and within_errors(matches):
        sentence = "no motion, the smears are no longer than their errors"
        return Assessment(config=Configuration.DEGENERATE, sentence=sentence, fit=fit)
    sample = np.sort(rng.permutation(len(matches))[:SAMPLE])
    plane = find_plane(problem.subset(sample).weighted, problem.has_camera, rng)
    if plane is None:
        config = Configuration.UNDEFINED if no_consensus else Configuration.UNCALIBRATED
        return Assessment(config=config, sentence="no homography fits", fit=fit, trusted=not no_consensus)
    # Deviations as stated: what F leaves is smaller where few smears are independent, for F takes up errors
    # that neighbours share.
    stated = replace(problem.subset(sample), scale=problem.noise_scale)

    def evidence_of(fit: Fit) -> Evidence:
        return parallax_evidence(plane.generator(), fit.point.matrix(), stated.weighted, stated.unit_px)

    evidence = evidence_of(fit)
    if not no_consensus:
        on_plane = transfer_orders(plane.generator(), problem.weighted)
        motions = find_two_motions(problem, fit.point.matrix(), on_plane.swapped, evidence.on_plane, rng)
        if motions is not None and motions.are_several:
            return several_motions(len(matches), motions, fit)
        if motions is not None:
            fit = lower_cost(problem, fit, motions.F)  # one motion, but perhaps a better F of it
            evidence = evidence_of(fit)
        off_plane = np.flatnonzero(on_plane.least**2 >= CUTOFF**2)
        through = plane_and_parallax(plane.generator(), problem, off_plane, rng)
        if through is not None:
            other = fit_from(through, problem)
            new = evidence_of(other)
            if problem.data_weight * (new.gain - evidence.gain) > CLEARLY:
                fit, evidence = other, new
    count = problem.data_weight * len(sample)
    gain = problem.data_weight * evidence.gain
    figures = f"parallax gains {gain:z.0f} over one homography ({PROVEN:.0f} needed)"
    if not no_consensus and gain >= PROVEN:
        sentence = f"parallax is proven: {figures}"
        return Assessment(config=Configuration.UNCALIBRATED, sentence=sentence, fit=fit, trusted=True)
    little = PROVEN * float(np.interp(problem.data_weight, (0, 1), NO_GAIN))
    absent = count >= LEAST_INDEPENDENT and gain < little and evidence.on_plane >= LEAST_ON_PLANE
    if no_consensus and not absent:
        return Assessment(config=Configuration.UNDEFINED, sentence="no consensus", fit=fit)
    return without_parallax(matches, problem, fit, plane, sample, absent, figures)


def without_parallax(
    matches: SmearMatches,
    problem: SmearProblem,
    fit: Fit,
    plane: PlaneH,
    sample: NDArray[np.int_],
    absent: bool,
    figures: str,
) -> Assessment:
    """Return the assessment of a rotation, a plane, or either, from a first homography.

    F stays beside it unless parallax is absent. Without a camera there are no rotations.
    """
    along, across = matches.subset(sample).bulk_px
    data = FlowData.of(problem.subset(sample), (problem.noise_scale * along, problem.noise_scale * across))
    any_homography = fit_flow(plane, data)
    generator, config = any_homography.family.generator(), Configuration.PLANAR_OR_PANORAMIC
    comparison = "without an image size a rotation cannot be told from a plane"
    if problem.has_camera:
        rotation = fit_flow(RotationH.from_generator(generator, problem.prior), data)
        gain = rotation.cost - any_homography.cost
        needed = MARGIN + EXTRA * float(np.log(max(problem.data_weight * len(sample), np.e)))
        comparison = f"any homography gains {gain:z.0f} over a rotation ({needed:.0f} needed)"
        config = Configuration.PANORAMIC if gain < needed else Configuration.PLANAR
        generator = rotation.family.generator() if gain < needed else generator
    prefix = "there is no parallax" if absent else "parallax is undecided"
    sentence = f"{prefix}: {figures}; {comparison}"
    return Assessment(config=config, sentence=sentence, fit=fit, trusted=not absent, generator=generator)


def within_errors(matches: SmearMatches) -> bool:
    """Return whether the shorter smears are as short as errors alone make them, up to half outliers.

    Of displacements that are errors of standard deviation sigma, the squared length over sigma^2 is
    distributed exponentially with mean 1.
    """
    quantile, outliers = SHORT
    ratio = (matches.length_px / matches.sigma_px) ** 2
    return bool(np.quantile(ratio, quantile) < -np.log(1 - quantile / outliers))


def several_motions(count: int, motions: TwoMotions, fit: Fit) -> Assessment:
    """Return the assessment of several motions; its F is the best single one.

    It follows the motion of most smears more closely than F of the smears of one motion do, for these are
    separated by place: of 31 synthetic scenes with a second motion of 30 or 45 % F of the larger part had a
    median rho under 0.05 in 17, the single one in 21.
    """
    sentence = (
        f"{motions.first:.0%} and {motions.second:.0%} of {count} smears follow two motions, "
        f"{motions.single:.0%} the best single one"
    )
    return Assessment(config=Configuration.MULTIPLE, sentence=sentence, fit=fit, trusted=True)


def lower_cost(problem: SmearProblem, fit: Fit, F: Array) -> Fit:
    """Return the fit of lower cost: one as given, or the richest plausible family refined from F (3, 3).

    Standard deviations are those that the given one left; the other, if better, is refined at its own.
    """
    other = fit_from(F, problem)
    if other.score >= fit.score:
        return fit
    own = with_measured_noise(problem, other.point.matrix())
    return fit_best(other.model, [other.point], own)
