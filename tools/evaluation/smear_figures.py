"""Figures of predicted smears over rendered photographs: as a whole, by length, and what sigma is worth."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.smears.field import SmearField
from tools.datasets.testset import TestScene
from tools.metrics import DIRECTION_MIN_PX, direction_error_deg, epe_s, sparsification_area
from tools.pages import Record, record_table, table

OCTAVES_PX = (1, 2, 4, 8, 16, 32, 64)
"""Lower ends of the classes of true length; each ends where the next begins, the last at twice its start."""
SIGMA_BINS = 10  # classes of equal size in which predicted and found errors are compared


OCTAVE_HEAD = "true px | smears | ratio | spread | direction, deg | EPE-S / length"
OCTAVE_ROW = (
    "{from_px} to {to_px} | {smears} | {length_ratio:.3f} | {length_spread:.3f} | {direction_deg:.2f} "
    "| {epe_s_over_length:.3f}"
)
SIGMA_HEAD = "sigma, px (tenths of the smears) | RMS error, px | over sigma | errors within sigma"


@dataclass(frozen=True, kw_only=True)
class SmearFigures:
    """Quality of the predicted smears over the valid pixels of the split; lengths in pixels.

    ``octaves`` and ``bins`` are what `by_octave` and `by_sigma` give.
    """

    images: int
    epe_s: float
    epe_s_over_length: float
    epe_s_top50: float
    epe_s_top50_over_length: float
    direction_deg: float
    direction_deg_top50: float
    length_ratio: float
    length_spread: float
    sparsification_area: float
    octaves: tuple[Record, ...] = ()
    bins: tuple[Record, ...] = ()


class Smears(NamedTuple):
    """Smears of many images.

    ``found`` and ``true`` (N, 2) are displacements, ``sigma`` (N,) their expected error, pixels; ``sure``
    (N,) whether it is at most its median over the image.
    """

    found: AnyArray
    true: AnyArray
    sigma: AnyArray
    sure: AnyArray


def pooled(scenes: Iterable[tuple[TestScene, SmearField]]) -> tuple[Smears, int]:
    """Return the valid pixels of all images, and the number of images."""
    parts = []
    for scene, field in scenes:
        sigma = field.sigma_px[1::4, 1::4][scene.valid]
        found = field.displacement[1::4, 1::4][scene.valid]
        true, sure = scene.displacement[scene.valid], sigma <= np.median(sigma)
        parts.append((found, true, sigma, sure))
    return Smears(*map(np.concatenate, zip(*parts, strict=True))), len(parts)


def evaluate_smears(smears: Smears, images: int = 1) -> SmearFigures:
    """Return the figures of all smears together; "top 50 %" is the more certain half of each image."""
    error, length = epe_s(smears.found, smears.true), np.linalg.norm(smears.true, axis=1)
    angle, clear = direction_error_deg(smears.found, smears.true), length >= DIRECTION_MIN_PX
    ratio, half = log_ratio(smears.found, length)[clear], smears.sure
    return SmearFigures(
        images=images,
        epe_s=float(error.mean()),
        epe_s_over_length=float(error.mean() / length.mean()),
        epe_s_top50=float(error[half].mean()),
        epe_s_top50_over_length=float(error[half].mean() / length[half].mean()),
        direction_deg=float(np.median(angle[clear])),
        direction_deg_top50=float(np.median(angle[clear & half])),
        length_ratio=float(np.exp(np.median(ratio))),
        length_spread=float(np.median(np.abs(ratio - np.median(ratio)))),
        sparsification_area=float(sparsification_area(error, smears.sigma)),
        octaves=tuple(by_octave(smears.found, smears.true)),
        bins=tuple(by_sigma(error, smears.sigma)),
    )


def log_ratio(found: AnyArray, length: AnyArray) -> AnyArray:
    """Return the log of predicted over true length (N,), a tenth of a pixel added so that it is finite."""
    return np.asarray(np.log((np.linalg.norm(found, axis=1) + 0.1) / np.maximum(length, 1e-6)))


def by_octave(found: AnyArray, true: AnyArray) -> Iterable[Record]:
    """Yield the figures of every class of true length that has smears (N, 2), as OCTAVE_ROW shows them."""
    length, error = np.linalg.norm(true, axis=1), epe_s(found, true)
    ratio, angle = log_ratio(found, length), direction_error_deg(found, true)
    for start in OCTAVES_PX:
        chosen = (length >= start) & (length < 2 * start)
        if chosen.any():
            middle = np.median(ratio[chosen])
            yield {
                "from_px": start,
                "smears": int(chosen.sum()),
                "length_ratio": float(np.exp(middle)),
                "length_spread": float(np.median(np.abs(ratio[chosen] - middle))),
                "direction_deg": float(np.median(angle[chosen])),
                "epe_s_over_length": float(error[chosen].mean() / length[chosen].mean()),
            }


def octave_table(octaves: Iterable[Record]) -> list[str]:
    """Return figures by length as lines of Markdown."""
    return record_table(OCTAVE_HEAD, OCTAVE_ROW, (one | {"to_px": 2 * one["from_px"]} for one in octaves))


def by_sigma(error: AnyArray, sigma: AnyArray) -> Iterable[Record]:
    """Yield, of tenths of the smears by sigma, root mean squares of it and of the error, pixels.

    ``within`` is the share of errors up to sigma.
    """
    for chosen in np.array_split(np.argsort(sigma, kind="stable"), min(SIGMA_BINS, len(sigma))):
        some = {"sigma_px": sigma[chosen], "error_px": error[chosen]}
        squares = {name: float(np.sqrt((one.astype(float) ** 2).mean())) for name, one in some.items()}
        yield squares | {"within": float((error[chosen] <= sigma[chosen]).mean())}


def smear_tables(smears: SmearFigures) -> list[str]:
    """Return the figures as lines of Markdown: all, by length, by sigma."""
    plain = [f.name for f in fields(smears) if f.name not in ("octaves", "bins")]
    whole = table("smears | ", [(name, f"{getattr(smears, name):.4g}") for name in plain])
    bins = [(b["sigma_px"], b["error_px"], b["error_px"] / b["sigma_px"], b["within"]) for b in smears.bins]
    sigmas = table(SIGMA_HEAD, [[f"{value:.2f}" for value in row] for row in bins])
    return [*whole, "", *octave_table(smears.octaves), "", *sigmas]
