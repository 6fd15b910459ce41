"""Which model the smears show: a table of all, a probability of each, and a name.

Every model is a displacement field judged by the same likelihood (`HomographyFit.costs`) on the same smears:
no motion, a rotation, any homography (a plane), the latter two also with a motion that changes down the rows
of a rolling shutter, and the plane with parallax along the epipolar lines of F. One calibrated step
(`model_probabilities`) turns their log-likelihoods, of the effective number of smears, into probabilities. By
its probability parallax is proven, undecided or absent. Where few smears are independent a small probability
does not mean that it is absent: then F is given with the homography beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from blur2view.geometry.configuration import Cause, Configuration, ModelRow, MotionModel, Refusal
from blur2view.geometry.epipolar import symmetric_skew
from blur2view.smears.camera_motion import has_moved, within_errors
from blur2view.two_view import constants as c
from blur2view.two_view.fundamental import FundamentalFit
from blur2view.two_view.homography import FieldLikelihood, HomographyFit, find_plane, fit_homography
from blur2view.two_view.likelihood import NormalisedSmears
from blur2view.two_view.models import HomographyFlow


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """The configuration, what decided on it, whether F is reported, and the homography, where one is."""

    config: Configuration
    refusal: Refusal | None = None
    models: tuple[ModelRow, ...] = ()
    reports_F: bool = False
    few_follow_F: bool = False  # else parallax would be proven
    homography: HomographyFit | None = None


class Candidate(NamedTuple):
    """A model and its fitted field (for parallax, the plane's); `rolls`: with a rolling shutter."""

    model: MotionModel
    fit: HomographyFit
    log_posterior: float
    rolls: bool = False


def choose(
    smears: NormalisedSmears, fit: FundamentalFit, *, agreement: float, rolling: bool, moved: bool = False
) -> Choice:
    """Choose a model, given the F of least cost.

    ``agreement`` is the share of the smears that follow F beyond chance: below MIN_AGREEMENT the model of
    parallax is left out. With ``rolling`` the models of a rolling shutter are added. If the camera is known
    to have ``moved``, the model "no motion" is left out.
    """
    has_consensus = agreement >= c.MIN_AGREEMENT
    if not has_consensus and not moved and within_errors(smears.matches):
        return Choice(config=Configuration.DEGENERATE, refusal=Refusal(cause=Cause.WITHIN_ERRORS))
    sample = smears.thinned(c.SAMPLE)
    residuals = FundamentalFit(point=fit.point, smears=sample, sign=fit.sign).residuals
    orders = residuals.backward, residuals.forward_share < 0.5  # the second counts depth as well
    plane = find_plane(FieldLikelihood(smears=sample), fit.point.motion()[0], *orders)
    candidates = fields_about(plane, rolling=rolling)
    if moved:
        candidates = [candidate for candidate in candidates if candidate.model is not MotionModel.STILL]
    if has_consensus:
        gain = plane.parallax_gain(fit.point.matrix())
        candidates.append(Candidate(MotionModel.PARALLAX, plane, plane.log_posterior + gain))
    return named_choice(candidates, model_probabilities(candidates, sample), agreement)


def fields_about(plane: HomographyFit, *, rolling: bool) -> list[Candidate]:
    """Return all models but parallax, their fields fitted from that of a plane."""
    likelihood, smears = plane.likelihood, plane.likelihood.smears
    still = HomographyFlow.plane(np.zeros(8), smears.prior_sigma)
    vector = symmetric_skew(plane.family.generator())[1]  # the skew part is the nearest rotation's
    rotation = fit_homography(likelihood, HomographyFlow.rotation(vector, smears.prior_sigma))
    fits = {
        MotionModel.STILL: HomographyFit(likelihood=likelihood, family=still),
        MotionModel.PLANE: plane,
        MotionModel.ROTATION: rotation,
    }
    candidates = [Candidate(model, fit, fit.log_posterior) for model, fit in fits.items()]
    if rolling:
        width, height = smears.matches.image_size or (1, 1)
        rows_axis = int(height <= width)  # a sensor's rows follow one another along the shorter side
        for model in (MotionModel.PLANE, MotionModel.ROTATION):
            rolled = fit_homography(likelihood, fits[model].family.rolling(rows_axis))
            candidates.append(Candidate(model, rolled, rolled.log_posterior, rolls=True))
    return candidates


def parameters_and_penalty(candidate: Candidate) -> tuple[int, float]:
    """Return the number of parameters of a model, and its penalty beside Schwarz's."""
    parameters, penalty = c.MODELS[candidate.model]
    if not candidate.rolls:
        return parameters, penalty
    added_parameters, added_penalty = c.ROLLING
    return parameters + added_parameters, penalty + added_penalty


def model_probabilities(candidates: list[Candidate], smears: NormalisedSmears) -> list[float]:
    """Return the models' probabilities: the one calibrated step, the same for all photographs.

    Errors that neighbours share look like fields and like parallax, so log-likelihoods count as many smears
    as are independent after all correlation. From them are taken a penalty of the model and that of Schwarz's
    criterion: half the logarithm of the number of smears for every parameter.
    """
    correlated = smears.fully_correlated
    slope = correlated.effective_share / smears.effective_share
    by_parameter = 0.5 * float(np.log(max(correlated.effective_count / c.PENALTY_COUNT, 1.0)))
    scores = []
    for candidate in candidates:
        parameters, penalty = parameters_and_penalty(candidate)
        scores.append(slope * candidate.log_posterior - penalty - by_parameter * parameters)
    odds = np.exp(np.array(scores) - max(scores))
    return [float(p) for p in odds / odds.sum()]


def named_choice(candidates: list[Candidate], probabilities: list[float], agreement: float) -> Choice:
    """Return the choice: with F unless parallax is absent, with the homography unless parallax is proven.

    PLANAR_OR_PANORAMIC is not that rotation and plane are equally likely. It is given where "no motion" is
    the likeliest model, at a probability of at most one half; the homography is then that of the likelier of
    rotation and plane.
    """
    pairs = list(zip(probabilities, candidates, strict=True))
    by_probability = sorted(pairs, key=lambda pair: pair[0])
    likeliest = {candidate.model: candidate for _, candidate in by_probability}  # with rolling shutter or not
    odds = dict.fromkeys((candidate.model for candidate in candidates), 0.0)
    for p, candidate in pairs:
        odds[candidate.model] += p
    rows = tuple(
        ModelRow(
            model=model,
            parameters=parameters_and_penalty(likeliest[model])[0],
            log_likelihood=likeliest[model].log_posterior,
            probability=odds[model],
        )
        for model in sorted(odds, key=lambda model: -odds[model])
    )
    parallax = odds.get(MotionModel.PARALLAX, 0.0)
    if parallax >= c.PROVEN_FROM and agreement >= c.PROVEN_AGREEMENT:
        return Choice(config=Configuration.UNCALIBRATED, models=rows, reports_F=True)
    if not has_moved(1 - odds.get(MotionModel.STILL, 0.0)):
        return Choice(config=Configuration.DEGENERATE, models=rows)
    plane = likeliest[MotionModel.PLANE].fit
    on_plane = float((np.hypot(*plane.residual) < c.ON_PLANE).mean())
    enough = plane.likelihood.smears.fully_correlated.has_many_independent and on_plane >= c.MIN_ON_PLANE
    # where it takes a rolling shutter to explain the smears, parallax may be there as well
    unrolled = sum(p for p, candidate in pairs if not candidate.rolls)
    absent = enough and parallax < c.ABSENT_BELOW * unrolled
    if agreement < c.MIN_AGREEMENT and not absent:
        return Choice(config=Configuration.UNDEFINED, models=rows)
    model = max((MotionModel.ROTATION, MotionModel.PLANE), key=lambda model: odds[model])
    config = Configuration.PANORAMIC if model is MotionModel.ROTATION else Configuration.PLANAR
    if rows[0].model is MotionModel.STILL:  # each other model is less likely, all together are not
        config = Configuration.PLANAR_OR_PANORAMIC
    return Choice(
        config=config,
        models=rows,
        reports_F=not absent,
        few_follow_F=parallax >= c.PROVEN_FROM,
        homography=likeliest[model].fit,
    )
