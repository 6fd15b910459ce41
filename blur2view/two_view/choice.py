"""Which model the smears show: a table of all, a probability of each, and a name.

Every model is a displacement field judged by the same likelihood (`HomographyFit.costs`) on the same
smears: none, a rotation, one whose rate changes down the rows of a rolling shutter, any homography, and that
homography with parallax along the lines of F. One calibrated step (`probabilities`) leads from their
log-likelihoods, of the effective number of smears, to probabilities. Parallax is proven, undecided or absent
as its probability lies in a range; where few smears are independent a small one does not mean that it is
absent: then F is given with the homography beside it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from blur2view.geometry.two_view_geometry import Configuration, ModelRow, ModelTable, MotionModel
from blur2view.two_view import constants as c
from blur2view.two_view.consensus import within_errors
from blur2view.two_view.fit_homography import HomographyFit, find_plane, fit_homography
from blur2view.two_view.fundamental import FundamentalFit
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.models import HomographyFlow, rotation_of

ROLLING = {MotionModel.ROTATION: MotionModel.ROLLING_ROTATION, MotionModel.PLANE: MotionModel.ROLLING_PLANE}


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """What the smears show, why, and the models behind it.

    ``fit`` is the F of least cost (of normalised coordinates), given where ``reports_F``; ``homography`` that
    which explains the smears, if one does.
    """

    config: Configuration
    sentence: str
    fit: FundamentalFit
    reports_F: bool = False
    homography: HomographyFit | None = None
    table: ModelTable = field(default_factory=ModelTable)


def choose(
    likelihood: Likelihood, fit: FundamentalFit, rng: np.random.Generator, *, agreement: float, rolling: bool
) -> Choice:
    """Return what the smears show, given the F of least cost.

    ``agreement`` is the share of the smears that follow it beyond chance: below MIN_AGREEMENT only a
    homography is looked for. With ``rolling`` the shutter may read one row after the other.
    """
    has_consensus = agreement >= c.MIN_AGREEMENT
    if not has_consensus and within_errors(likelihood.matches):
        sentence = "no motion, the smears are no longer than their errors"
        return Choice(config=Configuration.DEGENERATE, sentence=sentence, fit=fit)
    sample = likelihood.subset(np.sort(rng.permutation(len(likelihood))[: c.SAMPLE]))
    there = FundamentalFit(point=fit.point, likelihood=sample, sign=fit.sign)
    orders = there.residuals.backward, there.residuals.forward_share < 0.5  # by F, and by depth as well
    plane = find_plane(sample, fit.point.motion()[0], orders)
    fields = fields_of(sample, plane, rolling)
    plane = fields[MotionModel.PLANE]
    table = table_of(fields, plane.gain_of_parallax(fit.point.matrix()) if has_consensus else None)
    return named(table, fields, fit, agreement)


def fields_of(sample: Likelihood, plane: HomographyFit, rolling: bool) -> dict[MotionModel, HomographyFit]:
    """Return every displacement field, fitted; without a camera there are no rotations."""
    prior = sample.prior
    fields = {
        MotionModel.STILL: HomographyFit(likelihood=sample, family=HomographyFlow.plane(np.zeros(8), prior))
    }
    if sample.has_camera:
        rotation = HomographyFlow.rotation(rotation_of(plane.family.generator()), prior)
        fields[MotionModel.ROTATION] = fit_homography(rotation, sample)
    fields[MotionModel.PLANE] = plane
    if rolling:
        for still_model in [model for model in ROLLING if model in fields]:
            middle = fields[still_model].family
            fields[ROLLING[still_model]] = fit_homography(middle.rolling(0), sample, middle.rolling(1))
    return fields


def table_of(fields: dict[MotionModel, HomographyFit], gain: float | None) -> ModelTable:
    """Return the table of the fields and, where F has a ``gain`` over the plane, of parallax."""
    plane = fields[MotionModel.PLANE]
    log_likelihood = {model: fit.log_posterior for model, fit in fields.items()}
    if gain is not None:
        log_likelihood[MotionModel.PARALLAX] = log_likelihood[MotionModel.PLANE] + gain
    likelihood = plane.likelihood
    odds = probabilities(log_likelihood, likelihood)
    rows = [
        ModelRow(model=model, parameters=c.MODELS[model][0], log_likelihood=value, probability=odds[model])
        for model, value in log_likelihood.items()
    ]
    rows.sort(key=lambda row: -row.probability)
    return ModelTable(rows=tuple(rows), effective_count=likelihood.effective_count)


def probabilities(
    log_likelihood: dict[MotionModel, float], likelihood: Likelihood
) -> dict[MotionModel, float]:
    """Return the models' probabilities: the one calibrated step, the same for all photographs.

    Errors that neighbours share look like fields and like parallax: of the log-likelihoods those of smears
    with all correlation counted. Each model has a penalty, which grows with the number of smears by Schwarz's
    criterion.
    """
    slope = likelihood.fully_correlated.effective_share / likelihood.effective_share
    more = 0.5 * float(np.log(max(likelihood.fully_correlated.effective_count / c.PENALTY_COUNT, 1.0)))
    rows = [(value, *c.MODELS[model]) for model, value in log_likelihood.items()]
    score = [slope * value - penalty - more * parameters for value, parameters, penalty in rows]
    odds = np.exp(np.array(score) - max(score))
    return dict(zip(log_likelihood, (float(p) for p in odds / odds.sum()), strict=True))


def named(
    table: ModelTable, fields: dict[MotionModel, HomographyFit], fit: FundamentalFit, agreement: float
) -> Choice:
    """Return the choice of a table: F if parallax is not absent, and the homography unless it is proven."""
    parallax = table.probability(MotionModel.PARALLAX) or 0.0
    if parallax >= c.PROVEN_FROM and agreement >= c.PROVEN_AGREEMENT:
        sentence = f"parallax is proven: {figures_of(table)}"
        return Choice(
            config=Configuration.UNCALIBRATED, sentence=sentence, fit=fit, reports_F=True, table=table
        )
    first, probability = table.likeliest()
    still = table.probability(MotionModel.STILL) or 0.0
    if still > 0.5:
        sentence = f"no motion: probability {still:.2f}"
        return Choice(config=Configuration.DEGENERATE, sentence=sentence, fit=fit, table=table)
    on_plane = float((np.hypot(*fields[MotionModel.PLANE].residual) < c.ON_PLANE).mean())
    count = fields[MotionModel.PLANE].likelihood.fully_correlated.effective_count
    enough = count >= c.LEAST_INDEPENDENT and on_plane >= c.LEAST_ON_PLANE
    at_once = sum(table.probability(model) or 0.0 for model in fields if model not in ROLLING.values())
    # where a shutter that reads row after row is what explains the smears, parallax may be there as well
    absent = enough and parallax < c.ABSENT_BELOW * (parallax + at_once)
    if agreement < c.MIN_AGREEMENT and not absent:
        return Choice(config=Configuration.UNDEFINED, sentence="no consensus", fit=fit, table=table)
    config, model = Configuration.PLANAR_OR_PANORAMIC, MotionModel.PLANE
    comparison = "without an image size a rotation cannot be distinguished from a plane"
    if MotionModel.ROTATION in fields:
        turns = [m for m in (MotionModel.ROTATION, MotionModel.ROLLING_ROTATION) if m in fields]
        flat = MotionModel.PLANE, MotionModel.ROLLING_PLANE
        of_turn, of_plane = table.probability(*turns) or 0.0, table.probability(*flat) or 0.0
        comparison = f"of a rotation {of_turn:.2f}, of a plane {of_plane:.2f}"
        is_turn = of_turn >= of_plane
        config = Configuration.PANORAMIC if is_turn else Configuration.PLANAR
        model = max(turns, key=lambda m: table.probability(m) or 0.0) if is_turn else model
        if first is MotionModel.STILL:  # likelier than each, not than all others
            config = Configuration.PLANAR_OR_PANORAMIC
    likeliest = f"{first}, probability {probability:.2f}"
    few = ", as few smears follow F" * (parallax >= c.PROVEN_FROM)
    prefix = "there is no parallax" if absent else f"parallax is undecided{few}"
    return Choice(
        config=config,
        sentence=f"{likeliest}; {prefix}: {figures_of(table)}; {comparison}",
        fit=fit,
        reports_F=not absent,
        homography=fields[model],
        table=table,
    )


def figures_of(table: ModelTable) -> str:
    """Return the clause with the probability of parallax and what it rests on."""
    parallax = [row for row in table.rows if row.model is MotionModel.PARALLAX]
    if not parallax:
        return "no F to compare with"
    others = max(row.log_likelihood for row in table.rows if row.model is not MotionModel.PARALLAX)
    ratio = parallax[0].log_likelihood - others
    return f"probability {parallax[0].probability:.2f} (log-likelihood ratio {ratio:z.0f})"
