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
from functools import partial

import numpy as np

from blur2view.geometry.two_view_geometry import FAMILIES, Configuration, ModelRow, ModelTable, MotionModel
from blur2view.two_view import constants as c
from blur2view.two_view.consensus import within_errors
from blur2view.two_view.fundamental import FundamentalFit
from blur2view.two_view.homography import HomographyFit, find_plane, fit_homography
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.models import HomographyFlow, rotation_of

WITHOUT_SIZE = "without an image size a rotation cannot be told from a plane"
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
    likelihood: Likelihood,
    fit: FundamentalFit,
    rng: np.random.Generator,
    *,
    agreement: float,
    rolling: bool,
    moved: bool = False,
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
    sample = likelihood.subset(np.sort(rng.permutation(len(likelihood))[: c.SAMPLE]))
    there = FundamentalFit(point=fit.point, likelihood=sample, sign=fit.sign)
    orders = there.residuals.backward, there.residuals.forward_share < 0.5  # by F, and by depth as well
    plane = find_plane(sample, fit.point.motion()[0], orders)
    fields = fields_of(sample, plane, rolling)
    if moved:
        del fields[MotionModel.STILL]
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

    def odds(*models: MotionModel) -> float:
        return table.probability(*models) or 0.0

    parallax, still = odds(MotionModel.PARALLAX), odds(MotionModel.STILL)
    choice = partial(Choice, fit=fit, table=table)
    if parallax >= c.PROVEN_FROM and agreement >= c.PROVEN_AGREEMENT:
        sentence = f"parallax is proven: {figures_of(table)}"
        return choice(config=Configuration.UNCALIBRATED, sentence=sentence, reports_F=True)
    if still > 0.5:
        return choice(config=Configuration.DEGENERATE, sentence=f"no motion: probability {still:.2f}")
    plane = fields[MotionModel.PLANE]
    on_plane = float((np.hypot(*plane.residual) < c.ON_PLANE).mean())
    count = plane.likelihood.fully_correlated.effective_count
    enough = count >= c.LEAST_INDEPENDENT and on_plane >= c.LEAST_ON_PLANE
    # where a shutter that reads row after row is what explains the smears, parallax may be there as well
    at_once = odds(*(model for model in fields if model not in ROLLING.values()))
    absent = enough and parallax < c.ABSENT_BELOW * (parallax + at_once)
    if agreement < c.MIN_AGREEMENT and not absent:
        return choice(config=Configuration.UNDEFINED, sentence="no consensus")
    first, probability = table.likeliest()
    config, model, comparison = Configuration.PLANAR_OR_PANORAMIC, MotionModel.PLANE, WITHOUT_SIZE
    if MotionModel.ROTATION in fields:
        turns, flat = FAMILIES[MotionModel.ROTATION], FAMILIES[MotionModel.PLANE]
        is_turn = odds(*turns) >= odds(*flat)
        comparison = f"of a rotation {odds(*turns):.2f}, of a plane {odds(*flat):.2f}"
        if is_turn:
            model = max((one for one in turns if one in fields), key=odds)
        if first is not MotionModel.STILL:  # which is likelier than each, not than all others
            config = Configuration.PANORAMIC if is_turn else Configuration.PLANAR
    few = ", as few smears follow F" * (parallax >= c.PROVEN_FROM)
    sentence = f"{'there is no parallax' if absent else f'parallax is undecided{few}'}: {figures_of(table)}"
    if first is MotionModel.PARALLAX and not few:
        sentence += f", less than the {c.PROVEN_FROM:g} that would prove it"
    elif first is not MotionModel.PARALLAX:
        sentence = f"{first}, probability {probability:.2f}; {sentence}"
    sentence += f"; {comparison}"
    return choice(config=config, sentence=sentence, reports_F=not absent, homography=fields[model])


def figures_of(table: ModelTable) -> str:
    """Return the clause with the probability of parallax and what it rests on."""
    parallax = [row for row in table.rows if row.model is MotionModel.PARALLAX]
    if not parallax:
        return "no F to compare with"
    others = max(row.log_likelihood for row in table.rows if row.model is not MotionModel.PARALLAX)
    ratio = parallax[0].log_likelihood - others
    return f"probability {parallax[0].probability:.2f} (log-likelihood ratio {ratio:z.0f})"
