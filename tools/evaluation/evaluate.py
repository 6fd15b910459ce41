"""Measure smears and F on rendered photographs, or on the paper's data sets.

    python -m tools.datasets.testset render/test --scenes 60 --photos KODAK
    python -m tools.evaluation.evaluate render/test --paper 10 --out tools/results/evaluation.md

Every method gets the same matches, the network's own; F is judged on the true smears of static pixels. The
paper's Table 2 is of the first ``--paper`` photographs: its estimator and ours on the surest smears. Of the
first ``--fewer`` photographs F is also estimated through every second and third row and column of cells.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

import blur2view
from blur2view import SelectOptions, SmearGrid, SmearMatches, select_matches
from blur2view.arrays import AnyArray
from tools.command import Existing, Target, publish, run, table
from tools.datasets.synthetic_matches import KnownMatches
from tools.datasets.testset import TestScene, read_test_set
from tools.evaluation.baselines import METHODS, OURS, PAPER, against
from tools.evaluation.estimators import Measured, judge, measured, method_table
from tools.metrics import DIRECTION_MIN_PX, direction_error_deg, epe_s, sparsification_area

OCTAVES_PX = (1, 2, 4, 8, 16, 32, 64)  # lower ends of the classes of true length
OCTAVE_HEAD = "true px | smears | ratio | spread | direction, deg | EPE-S / length"
SIGMA_HEAD = "sigma, px (tenths of the smears) | RMS error, px | over sigma | errors within sigma"
SHARES = (0.2, 0.35, 0.45, 0.55)  # of the smears, the surest: the paper's Table 2

EVERY_CELL = 1, 2, 3  # rows and columns of which one is kept

Pair = tuple[TestScene, SmearGrid]


class Smears(NamedTuple):
    """Smears of many images: displacements ``found`` and ``true`` (N, 2), pixels.

    ``sigma`` (N,) is their expected error, ``sure`` (N,) whether it is at most its median over the image.
    """

    found: AnyArray
    true: AnyArray
    sigma: AnyArray
    sure: AnyArray


def pooled(pairs: Iterable[Pair]) -> Smears:
    """Return the smears of the valid pixels of all images."""
    parts = []
    for scene, grid in pairs:
        field = grid.at_pixels()
        found, sigma = (of[1::4, 1::4][scene.valid] for of in (field.displacement, field.sigma_px))
        parts.append((found, scene.displacement[scene.valid], sigma, sigma <= np.median(sigma)))
    return Smears(*map(np.concatenate, zip(*parts, strict=True)))


def smear_figures(smears: Smears) -> dict[str, float]:
    """Return the figures of smears; "top50" is the more certain half of each image."""
    error, length = epe_s(smears.found, smears.true), np.linalg.norm(smears.true, axis=1)
    angle, clear = direction_error_deg(smears.found, smears.true), length >= DIRECTION_MIN_PX
    half = smears.sure
    figures = {
        "epe_s": error.mean(),
        "epe_s_over_length": error.mean() / length.mean(),
        "epe_s_top50": error[half].mean(),
        "epe_s_top50_over_length": error[half].mean() / length[half].mean(),
        "direction_deg": np.median(angle[clear]),
        "direction_deg_top50": np.median(angle[clear & half]),
        **dict(zip(("length_ratio", "length_spread"), ratio_and_spread(smears, clear), strict=True)),
        "sparsification_area": sparsification_area(error, smears.sigma),
    }
    return {name: float(figure) for name, figure in figures.items()}


def ratio_and_spread(smears: Smears, chosen: AnyArray) -> tuple[float, float]:
    """Return the median of found over true length, and the median deviation of its logarithm.

    A tenth of a pixel is added to found lengths, so that the logarithm is finite.
    """
    found, true = (np.linalg.norm(of[chosen], axis=1) for of in (smears.found, smears.true))
    ratio = np.log((found + 0.1) / np.maximum(true, 1e-6))
    return float(np.exp(np.median(ratio))), float(np.median(np.abs(ratio - np.median(ratio))))


def by_octave(smears: Smears) -> Iterator[tuple[str, ...]]:
    """Yield the figures of every class of true length that has smears."""
    length, error = np.linalg.norm(smears.true, axis=1), epe_s(smears.found, smears.true)
    angle = direction_error_deg(smears.found, smears.true)
    for start in OCTAVES_PX:
        chosen = (length >= start) & (length < 2 * start)
        if chosen.any():
            share = error[chosen].mean() / length[chosen].mean()
            figures = (*ratio_and_spread(smears, chosen), np.median(angle[chosen]), share)
            yield f"{start} to {2 * start}", f"{chosen.sum()}", *(f"{figure:.3f}" for figure in figures)


def by_sigma(smears: Smears) -> Iterator[tuple[str, ...]]:
    """Yield, of tenths of the smears by sigma, root mean squares of sigma and error, and their ratio."""
    error = epe_s(smears.found, smears.true)
    for chosen in np.array_split(np.argsort(smears.sigma, kind="stable"), 10):
        sigma_px, error_px = (np.sqrt((x[chosen].astype(float) ** 2).mean()) for x in (smears.sigma, error))
        within = (error[chosen] <= smears.sigma[chosen]).mean()
        yield tuple(f"{value:.2f}" for value in (sigma_px, error_px, error_px / sigma_px, within))


def known_matches(scene: TestScene, matches: SmearMatches) -> KnownMatches:
    """Return matches read in a photograph with the truth; true smears give their order."""
    swapped = against(matches.ends, scene.truth_at(matches))
    truth = {"K": scene.K, "R": scene.R, "t": scene.t, "true_ends": scene.true_ends}
    return KnownMatches(**truth, matches=matches, swapped=swapped)


def of_methods(pairs: Iterable[Pair]) -> Iterator[Measured]:
    """Yield, for each photograph, how good every method but the paper's is, and the true F."""
    for scene, grid in pairs:
        known = known_matches(scene, select_matches(grid))
        true = judge(scene.F, known, scene.F) | {"ms": 0.0}
        yield measured(known, METHODS.keys() - {PAPER}, scene.F) | {"true F": true}


def of_shares(pairs: Iterable[Pair]) -> Iterator[Measured]:
    """Yield the instances of the paper's Table 2: each photograph and share of its smears."""
    for scene, grid in pairs:
        for share in SHARES:
            known = known_matches(scene, select_matches(grid, SelectOptions(beta=share)))
            found = measured(known, (OURS, PAPER), scene.F)
            yield {f"{name}, the surest {share:.0%}": one for name, one in found.items()}


def of_fewer_cells(pairs: Iterable[Pair]) -> Iterator[Measured]:
    """Yield, for each photograph, how good F is through some of its cells (`smear_network.MIN_CELLS`)."""
    for scene, grid in pairs:
        matches = select_matches(grid)
        cell = (matches.midpoint // grid.stride).astype(int)
        rows: Measured = {}
        for every in EVERY_CELL:
            some = matches.subset((cell % every == every // 2).all(axis=1))
            found = measured(known_matches(scene, some), (OURS,), scene.F)
            rows |= {f"{name}, every {every}. row and column": one for name, one in found.items()}
        yield rows


def main(
    scenes: Path, *, model: Existing | None = None, paper: int = 0, fewer: int = 0, out: Target | None = None
) -> None:
    """Evaluate a network, the shipped one by default, on a test set."""
    network = blur2view.SmearNetwork(model)
    pairs = [(scene, network.predict(scene.image)) for scene in read_test_set(scenes)]
    smears, moving = pooled(pairs), [pair for pair in pairs if pair[0].F is not None]
    publish(
        out,
        f"Model {network.model_id}, {len(pairs)} images.",
        table("smears | ", [(name, f"{value:.4g}") for name, value in smear_figures(smears).items()]),
        table(OCTAVE_HEAD, by_octave(smears)),
        table(SIGMA_HEAD, by_sigma(smears)),
        *(
            method_table(rows)
            for rows in map(
                list, (of_methods(moving), of_shares(moving[:paper]), of_fewer_cells(moving[:fewer]))
            )
            if rows
        ),
    )


if __name__ == "__main__":
    run(main)
