"""Which model the smears show: a table of all, a probability of each, and a name.

Every model is a displacement field judged by the same likelihood (`HomographyFit.costs`) on the same
smears: none, a rotation, any homography, both also with a rate that changes down the rows of a rolling
shutter, and that homography with parallax along the lines of F. One calibrated step (`rows_of`) leads from
their log-likelihoods, of the effective number of smears, to probabilities. Parallax is proven, undecided or
absent as its probability lies in a range; where few smears are independent a small one does not mean that it
is absent: then F is given with the homography beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from blur2view.geometry.two_view_geometry import Configuration, ModelRow, MotionModel
from blur2view.smears.matches import SmearMatches
from blur2view.two_view import constants as c
from blur2view.two_view.fundamental import FundamentalFit
from blur2view.two_view.homography import HomographyFit, find_plane, fit_homography
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.models import HomographyFlow, rotation_of


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """What the smears show, why, and the models behind it.

    ``fit`` is the F of least cost (of normalised coordinates), given where ``reports_F``; ``homography`` that
    which explains the smears, if one does.
    """

    config: Configuration
    sentence: str
    fit: FundamentalFit
    models: tuple[ModelRow, ...] = ()
    independent_smears: float = 0.0
    reports_F: bool = False
    homography: HomographyFit | None = None


class Field(NamedTuple):
    """A fitted field, or without one what parallax gains over a plane; ``rolls``: with a rolling shutter."""

    model: MotionModel
    rolls: bool
    fit: HomographyFit | None
    log_posterior: float


def choose(
    likelihood: Likelihood, fit: FundamentalFit, *, agreement: float, rolling: bool, moved: bool = False
) -> Choice:
    """Return what the smears show, given the F of least cost.

    ``agreement`` is the share of the smears that follow it beyond chance: below MIN_AGREEMENT only a
    homography is looked for. With ``rolling`` the shutter may read one row after the other; if the camera is
    known to have ``moved``, no motion is no model.
    """
    has_consensus = agreement >= c.MIN_AGREEMENT
    if not has_consensus and not moved and within_errors(likelihood.matches):
        sentence = "no motion, the smears are no longer than their errors"
        return Choice(config=Configuration.DEGENERATE, sentence=sentence, fit=fit)
    sample = likelihood.thinned(c.SAMPLE)
    there = FundamentalFit(point=fit.point, likelihood=sample, sign=fit.sign)
    orders = there.residuals.backward, there.residuals.forward_share < 0.5  # by F, and by depth as well
    plane = find_plane(sample, fit.point.motion()[0], *orders)
    fields = fields_of(sample, plane, rolling)[moved:]  # no motion is the first
    if has_consensus:
        gain = plane.gain_of_parallax(fit.point.matrix())
        fields.append(Field(MotionModel.PARALLAX, False, None, plane.log_posterior + gain))
    probabilities = probabilities_of(fields, sample)
    return named(fields, probabilities, plane, fit, agreement)


def within_errors(matches: SmearMatches) -> bool:
    """Return whether the shorter smears are as short as errors alone make them, up to half outliers.

    Of displacements that are errors of standard deviation sigma, the squared length over sigma^2 is
    distributed exponentially with mean 1.
    """
    ratio = (matches.length_px / matches.sigma_px) ** 2
    return bool(np.quantile(ratio, c.SHORT_QUANTILE) < -np.log(1 - c.SHORT_QUANTILE / c.SHORT_INLIERS))


def fields_of(sample: Likelihood, plane: HomographyFit, rolling: bool) -> list[Field]:
    """Return every displacement field, fitted; without a camera there are no rotations."""
    still = HomographyFlow.plane(np.zeros(8), sample.prior)
    fits = {MotionModel.STILL: HomographyFit(likelihood=sample, family=still), MotionModel.PLANE: plane}
    if sample.has_camera:
        turning = HomographyFlow.rotation(rotation_of(plane.family.generator()), sample.prior)
        fits[MotionModel.ROTATION] = fit_homography(sample, turning)
    fields = [Field(model, False, fit, fit.log_posterior) for model, fit in fits.items()]
    for model, fit in list(fits.items())[1:] if rolling else ():
        rolled = fit_homography(sample, fit.family.rolling(sample.rows_axis))
        fields.append(Field(model, True, rolled, rolled.log_posterior))
    return fields


def probabilities_of(fields: list[Field], likelihood: Likelihood) -> list[float]:
    """Return the fields' probabilities: the one calibrated step, the same for all photographs.

    Errors that neighbours share look like fields and like parallax: of the log-likelihoods those of smears
    with all correlation counted. Each model has a penalty, which grows with the number of smears by Schwarz's
    criterion.
    """
    correlated = likelihood.fully_correlated
    slope = correlated.effective_share / likelihood.effective_share
    more = 0.5 * float(np.log(max(correlated.effective_count / c.PENALTY_COUNT, 1.0)))
    score = []
    for field in fields:
        parameters, penalty = np.add(c.MODELS[field.model], np.multiply(field.rolls, c.ROLLING))
        score.append(slope * field.log_posterior - penalty - more * parameters)
    odds = np.exp(np.array(score) - max(score))
    return [float(p) for p in odds / odds.sum()]


def rows_of(fields: list[Field], probabilities: list[float]) -> tuple[ModelRow, ...]:
    """Return a row of each model, likeliest first, with a shutter of either kind."""
    rows = []
    for model in dict.fromkeys(field.model for field in fields):
        own = [(p, one) for p, one in zip(probabilities, fields, strict=True) if one.model is model]
        _, best = max(own, key=lambda pair: pair[0])
        rows.append(
            ModelRow(
                model=model,
                parameters=int(c.MODELS[model][0] + best.rolls * c.ROLLING[0]),
                log_likelihood=best.log_posterior,
                probability=sum(p for p, _ in own),
            )
        )
    return tuple(sorted(rows, key=lambda row: -row.probability))


def named(
    fields: list[Field],
    probabilities: list[float],
    plane: HomographyFit,
    fit: FundamentalFit,
    agreement: float,
) -> Choice:
    """Return the choice: F if parallax is not absent, and the homography unless it is proven."""
    rows, correlated = rows_of(fields, probabilities), plane.likelihood.fully_correlated
    odds = {row.model: row.probability for row in rows}
    parallax, still = odds.get(MotionModel.PARALLAX, 0.0), odds.get(MotionModel.STILL, 0.0)
    choice = partial(Choice, fit=fit, models=rows, independent_smears=plane.likelihood.effective_count)
    figures = "no F to compare with"
    if MotionModel.PARALLAX in odds:
        ratio = fields[-1].log_posterior - max(field.log_posterior for field in fields[:-1])
        figures = f"probability {parallax:.2f} (log-likelihood ratio {ratio:z.0f})"
    if parallax >= c.PROVEN_FROM and agreement >= c.PROVEN_AGREEMENT:
        sentence = f"parallax is proven: {figures}"
        return choice(config=Configuration.UNCALIBRATED, sentence=sentence, reports_F=True)
    if still > 0.5:
        return choice(config=Configuration.DEGENERATE, sentence=f"no motion: probability {still:.2f}")
    on_plane = float((np.hypot(*plane.residual) < c.ON_PLANE).mean())
    enough = correlated.has_many_independent and on_plane >= c.LEAST_ON_PLANE
    # where a shutter that reads row after row is what explains the smears, parallax may be there as well
    rolled = sum(p for p, field in zip(probabilities, fields, strict=True) if field.rolls)
    absent = enough and parallax < c.ABSENT_BELOW * (1 - rolled)
    if agreement < c.MIN_AGREEMENT and not absent:
        return choice(config=Configuration.UNDEFINED, sentence="no consensus")
    turns = odds.get(MotionModel.ROTATION, 0.0) >= odds[MotionModel.PLANE]
    model = MotionModel.ROTATION if turns else MotionModel.PLANE
    best = max(zip(probabilities, fields, strict=True), key=lambda one: (one[1].model is model, one[0]))[1]
    config = Configuration.PLANAR_OR_PANORAMIC
    comparison = "without an image size rotation and plane look alike"
    if MotionModel.ROTATION in odds:
        of_both = odds[MotionModel.ROTATION], odds[MotionModel.PLANE]
        comparison = "of a rotation {:.2f}, of a plane {:.2f}".format(*of_both)
        if rows[0].model is not MotionModel.STILL:  # which is likelier than each, not than all others
            config = Configuration.PANORAMIC if turns else Configuration.PLANAR
    sentence = f"{'there is no parallax' if absent else 'parallax is undecided'}: {figures}"
    if parallax >= c.PROVEN_FROM:
        sentence += ", but few smears follow F"
    elif rows[0].model is MotionModel.PARALLAX:
        sentence += f", less than the {c.PROVEN_FROM:g} that would prove it"
    else:
        sentence = f"{rows[0].model}, probability {rows[0].probability:.2f}; {sentence}"
    sentence += f"; {comparison}"
    return choice(config=config, sentence=sentence, reports_F=not absent, homography=best.fit)
