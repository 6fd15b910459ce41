"""Measure smears and F on the rendered test split.

    python -m tools.datasets.testset render/test --scenes 60 --photos KODAK
    python -m tools.evaluation.evaluate render/test --out tools/results/evaluation.md

prints the tables and writes the page. Every method gets the same matches, the network's own. F is judged on
the true smears of static pixels.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

import blur2view
from blur2view import SmearGrid, SmearMatches, select_matches
from blur2view.arrays import AnyArray
from blur2view.geometry.epipolar import serrmin
from tools.arguments import Existing, Target, run
from tools.datasets.synthetic_matches import KnownMatches
from tools.datasets.testset import TestScene, read_test_set
from tools.estimators.baselines import METHODS, OURS, against
from tools.metrics import (
    DIRECTION_MIN_PX,
    PAPER_INLIER,
    direction_error_deg,
    epe_s,
    epipole_angle_deg,
    rho,
    sparsification_area,
)
from tools.pages import Record, publish, record_table, table

OCTAVES_PX = (1, 2, 4, 8, 16, 32, 64)
"""Lower ends of the classes of true length; each ends where the next begins, the last at twice its start."""
OCTAVE_HEAD = "true px | smears | ratio | spread | direction, deg | EPE-S / length"
OCTAVE_ROW = (
    "{from_px} to {to_px} | {smears} | {length_ratio:.3f} | {length_spread:.3f} | {direction_deg:.2f} "
    "| {epe_s_over_length:.3f}"
)
SIGMA_HEAD = "sigma, px (tenths of the smears) | RMS error, px | over sigma | errors within sigma"
SHARES = ("under_05", "under_10", "inliers")  # what of `judge` is a share of the smears; the rest are errors
HEAD = (
    "F from | images | none | median rho | rho < 0.05 | rho < 0.10 | SErrMin < 3 | of the true F's "
    "| median SErrMin, px^2 | epipole, deg"
)
ROW = (
    "{method} | {images} | {without_F} | {rho:.4f} | {under_05:.3f} | {under_10:.3f} | {inliers:.3f} "
    "| {inliers_of_true:.3f} | {serrmin_px2:.3g} | {epipole_deg:.1f}"
)
NAMES = (
    OURS, "two-parameter F", "unordered, OpenCV MAGSAC", "u > 0 order, OpenCV MAGSAC",
    "true order, OpenCV MAGSAC", "true order, pycolmap", "true order, PoseLib",
)  # fmt: skip


class Smears(NamedTuple):
    """Smears of many images: displacements ``found`` and ``true`` (N, 2), pixels.

    ``sigma`` (N,) is their expected error, ``sure`` (N,) whether it is at most its median over the image.
    """

    found: AnyArray
    true: AnyArray
    sigma: AnyArray
    sure: AnyArray


def pooled(scenes: Iterable[tuple[TestScene, SmearGrid]]) -> Smears:
    """Return the valid pixels of all images."""
    parts = []
    for scene, grid in scenes:
        field = grid.at_pixels()
        sigma = field.sigma_px[1::4, 1::4][scene.valid]
        found = field.displacement[1::4, 1::4][scene.valid]
        parts.append((found, scene.displacement[scene.valid], sigma, sigma <= np.median(sigma)))
    return Smears(*map(np.concatenate, zip(*parts, strict=True)))


def smear_figures(smears: Smears) -> dict[str, float]:
    """Return the figures of all smears; "top50" is the more certain half of each image."""
    error, length = epe_s(smears.found, smears.true), np.linalg.norm(smears.true, axis=1)
    angle, clear = direction_error_deg(smears.found, smears.true), length >= DIRECTION_MIN_PX
    ratio, half = log_ratio(smears.found, length)[clear], smears.sure
    figures = {
        "epe_s": error.mean(),
        "epe_s_over_length": error.mean() / length.mean(),
        "epe_s_top50": error[half].mean(),
        "epe_s_top50_over_length": error[half].mean() / length[half].mean(),
        "direction_deg": np.median(angle[clear]),
        "direction_deg_top50": np.median(angle[clear & half]),
        "length_ratio": np.exp(np.median(ratio)),
        "length_spread": np.median(np.abs(ratio - np.median(ratio))),
        "sparsification_area": sparsification_area(error, smears.sigma),
    }
    return {name: float(figure) for name, figure in figures.items()}


def log_ratio(found: AnyArray, length: AnyArray) -> AnyArray:
    """Return the log of predicted over true length (N,), a tenth of a pixel added so that it is finite."""
    return np.asarray(np.log((np.linalg.norm(found, axis=1) + 0.1) / np.maximum(length, 1e-6)))


def by_octave(smears: Smears) -> Iterator[Record]:
    """Yield the figures of every class of true length that has smears."""
    length = np.linalg.norm(smears.true, axis=1)
    for start in OCTAVES_PX:
        chosen = (length >= start) & (length < 2 * start)
        if chosen.any():
            found, true = smears.found[chosen], smears.true[chosen]
            ratio = log_ratio(found, length[chosen])
            yield {
                "from_px": start,
                "to_px": 2 * start,
                "smears": int(chosen.sum()),
                "length_ratio": float(np.exp(np.median(ratio))),
                "length_spread": float(np.median(np.abs(ratio - np.median(ratio)))),
                "direction_deg": float(np.median(direction_error_deg(found, true))),
                "epe_s_over_length": float(epe_s(found, true).mean() / length[chosen].mean()),
            }


def by_sigma(smears: Smears, parts: int = 10) -> Iterator[tuple[str, ...]]:
    """Yield, of equal parts of the smears by sigma, root mean squares of sigma and error, and their ratio."""
    error = epe_s(smears.found, smears.true)
    for chosen in np.array_split(np.argsort(smears.sigma, kind="stable"), parts):
        sigma_px, error_px = (
            float(np.sqrt((x[chosen].astype(float) ** 2).mean())) for x in (smears.sigma, error)
        )
        within = float((error[chosen] <= smears.sigma[chosen]).mean())
        yield tuple(f"{value:.2f}" for value in (sigma_px, error_px, error_px / sigma_px, within))


def known_matches(scene: TestScene, matches: SmearMatches) -> KnownMatches:
    """Return matches read in a photograph with the truth; their order is by true smears."""
    swapped = against(matches.ends, scene.truth_at(matches))
    return KnownMatches(
        K=scene.K, R=scene.R, t=scene.t, matches=matches, true_ends=scene.true_ends, swapped=swapped,
        outlier=np.zeros_like(swapped),
    )  # fmt: skip


def judge(F: AnyArray | None, F_true: AnyArray | None, K: AnyArray, ends: AnyArray) -> dict[str, float]:
    """Return how good F is on true ends (N, 2, 2) of smears, beside the true F and for the true K.

    Medians of ``rho`` and ``serrmin_px2``; shares of smears with a rho below 0.05 and 0.10, and of the
    paper's inliers; the angle of the epipoles, up to the flip of time. None is the worst answer: errors as
    long as the smears, and an epipole at right angles.
    """
    if F is None or F_true is None:
        squared = float(np.median(((ends[:, 1] - ends[:, 0]) ** 2).sum(axis=1)))
        return dict.fromkeys(SHARES, 0.0) | {"rho": 1.0, "serrmin_px2": squared, "epipole_deg": 90.0}
    relative, squared_px = rho(F, ends), serrmin(F, ends)
    return {
        "rho": float(np.median(relative)),
        "under_05": float((relative < 0.05).mean()),
        "under_10": float((relative < 0.10).mean()),
        "inliers": float((squared_px < PAPER_INLIER).mean()),
        "serrmin_px2": float(np.median(squared_px)),
        "epipole_deg": epipole_angle_deg(F, F_true, K),
    }


def summarise(method: str, judged: list[dict[str, float]], true_inliers: float, missing: int) -> Record:
    """Return medians of the errors, means of the shares, and inliers as a fraction of the true F's."""
    values = {name: [one[name] for one in judged] for name in judged[0]}
    found = {name: float((np.mean if name in SHARES else np.median)(some)) for name, some in values.items()}
    shown = {"method": method, "images": len(judged), "without_F": missing}
    return found | shown | {"inliers_of_true": found["inliers"] / true_inliers}


def evaluate_fundamentals(scenes: Iterable[tuple[TestScene, SmearGrid]]) -> list[Record]:
    """Return figures of every method over the images whose camera translates; no F counts as the worst."""
    judged: dict[str, list[dict[str, float]]] = {}
    missing: dict[str, int] = {}
    for scene, grid in scenes:
        if scene.F is None:
            continue
        known = known_matches(scene, select_matches(grid))
        found = {name: METHODS[name](known) for name in NAMES} | {"true F": scene.F}
        for name, F in found.items():
            judged.setdefault(name, []).append(judge(F, scene.F, scene.K, known.true_ends))
            missing[name] = missing.get(name, 0) + (F is None)
    true_inliers = float(np.mean([one["inliers"] for one in judged["true F"]]))
    return [summarise(name, rows, true_inliers, missing[name]) for name, rows in judged.items()]


def main(scenes: Path, *, model: Existing | None = None, out: Target | None = None) -> None:
    """Evaluate a network, the shipped one by default, on a test set, and write the page."""
    network = blur2view.SmearNetwork(model)
    pairs = [(scene, network.predict(scene.image)) for scene in read_test_set(scenes)]
    smears = pooled(pairs)
    publish(
        out,
        f"Model {network.model_id}, {len(pairs)} images.",
        table("smears | ", [(name, f"{value:.4g}") for name, value in smear_figures(smears).items()]),
        record_table(OCTAVE_HEAD, OCTAVE_ROW, by_octave(smears)),
        table(SIGMA_HEAD, by_sigma(smears)),
        record_table(HEAD, ROW, evaluate_fundamentals(pairs)),
    )


if __name__ == "__main__":
    run(main)
