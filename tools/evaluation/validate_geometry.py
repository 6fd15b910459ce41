r"""Our F, inliers and pose beside those of pycolmap and OpenCV, on matches whose order is known.

    python -m tools.evaluation.validate_geometry --out tools/results/validation.md \
        [--sequence render/sequence]

Three sets of matches: exact smears in their true order; smears with noise and outliers in their true order;
the same in the order that we gave them, which is what a COLMAP database of ours holds. Ours is given no order
in any. ``--sequence`` adds the network's smears on frames that :mod:`tools.reconstruction.sequence` rendered.
F is judged on the true smears: the median Sampson distance in pixels, one flip of time for all of them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import blur2view
from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.camera.colmap_camera import to_colmap
from blur2view.geometry.sampson import sampson
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.metrics import rotation_error, translation_direction_error_deg
from blur2view.smears.field import smear_ends
from blur2view.two_view.estimate import estimate_two_view
from tools.arguments import existing, parser_of, target
from tools.datasets.synthetic_matches import IMAGE_SIZE, SyntheticOptions, SyntheticSmears, synthetic_smears
from tools.estimators.reference_methods import METHODS, Answer, Case
from tools.evaluation.pose_error import pose_of
from tools.reconstruction.sequence import read_sequence
from tools.rendering.exposure import grid_points

LENGTHS_PX = (12.0, 20.0, 40.0)
SEEDS = range(10)
LEGEND = """Written by `python -m tools.evaluation.validate_geometry`: medians over cases; "-": no F in half
of them.

Sampson: median distance of the true smears, and its 90 % quantile over the cases. Rotation and translation:
errors in degrees, translation without sign; an F without a pose is decomposed with the true K. Precision and
recall: share of the kept matches that are true, of the true ones that are kept. Ours is given no order, the
others that of the first column."""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """How far an answer is from the truth; infinite where it has none, NaN where the truth is not known."""

    sampson_px: float
    rotation_deg: float
    translation_deg: float
    precision: float
    recall: float
    config: str


def judge(answer: Answer, case: Case) -> Judged:
    """Return how good F is on the true smears, the pose, and the inliers; the better flip of time counts."""
    precision, recall = inlier_shares(answer.inlier, case.inlier)
    if answer.F is None:
        worst = float("inf")
        return Judged(
            sampson_px=worst,
            rotation_deg=worst,
            translation_deg=worst,
            precision=precision,
            recall=recall,
            config=answer.config,
        )
    rotation, translation = pose_errors(answer, case)
    return Judged(
        sampson_px=sampson_px(answer.F, case.true_ends),
        rotation_deg=rotation,
        translation_deg=translation,
        precision=precision,
        recall=recall,
        config=answer.config,
    )


def sampson_px(F: Array, ends: Array) -> float:
    """Return the median Sampson distance of true smears, pixels, of F or its transpose, the nearer one."""
    return min(float(np.sqrt(np.median(sampson(G, ends[:, 0], ends[:, 1])))) for G in (F, F.T))


def pose_errors(answer: Answer, case: Case) -> tuple[float, float]:
    """Return rotation and undirected translation error, degrees; an F alone is decomposed with the true K."""
    if answer.F is None:
        return float("inf"), float("inf")
    R, t = answer.R, answer.t
    if R is None or t is None:
        pose = pose_of(answer.F, case.camera.K, case.ordered)
        R, t = pose.rotation, pose.translation
    reverse = -case.R.T @ case.t
    translation = min(translation_direction_error_deg(t, true) for true in (case.t, reverse))
    return rotation_error(R, case.R)[0], translation


def inlier_shares(kept: NDArray[np.bool_], true: NDArray[np.bool_] | None) -> tuple[float, float]:
    """Return the share of the kept matches that are true, and of the true ones that are kept."""
    if true is None:
        return float("nan"), float(kept.mean())
    both = float((kept & true).sum())
    return both / max(kept.sum(), 1), both / max(true.sum(), 1)


def synthetic_case(smears: SyntheticSmears, ordered: Array) -> Case:
    """Return a case of synthetic smears in some order."""
    camera = pinhole(smears.K, IMAGE_SIZE)
    return Case(
        unordered=smears.matches,
        ordered=ordered,
        inlier=~smears.outlier,
        true_ends=smears.true_ends,
        camera=camera,
        R=smears.R,
        t=smears.t,
    )


def pinhole(K: Array, size: tuple[int, int]) -> Camera:
    """Return a known camera of K, with COLMAP's parameters."""
    params = (K[0, 0], K[1, 1], *to_colmap(K[:2, 2]))
    return Camera(K=K, width=size[0], height=size[1], params=tuple(map(float, params)))


def our_order(case: Case) -> Array:
    """Return the ends ordered as by our calibrated estimate, in the flip of time nearer the truth."""
    found: TwoViewGeometry = estimate_two_view(
        case.unordered, rng=np.random.default_rng(0), camera=case.camera
    )
    ends, swapped = case.unordered.ends, found.swapped[:, None, None]
    ordered = np.where(swapped, ends[:, ::-1], ends)
    if case.inlier is None:
        return ordered
    same = (ordered == case.ordered).all(axis=(1, 2))[case.inlier].mean()
    return ordered if same >= 0.5 else ordered[:, ::-1]


def synthetic_cases(seeds: Sequence[int], lengths_px: Sequence[float]) -> Iterator[tuple[str, Case]]:
    """Yield the three sets, by name."""
    for length in lengths_px:
        for seed in seeds:
            options = SyntheticOptions(length_px=length, noise_px=0.0, outliers=0.0)
            exact = synthetic_smears(seed, options)
            yield "exact, true order", synthetic_case(exact, exact.ordered)
            noisy = synthetic_smears(seed, replace(options, noise_px=0.5, outliers=0.3))
            case = synthetic_case(noisy, noisy.ordered)
            yield "0.5 px, 30 % outliers, true order", case
            yield "0.5 px, 30 % outliers, our order", replace(case, ordered=our_order(case))


def network_cases(folder: Path) -> Iterator[tuple[str, Case]]:
    """Yield the network's smears on a rendered sequence, in the true and in our order."""
    network = blur2view.SmearNetwork()
    paths, truth = read_sequence(folder)
    for path, displacement, relative in zip(paths, truth.displacement, truth.relative, strict=True):
        matches = blur2view.select_matches(network.predict(blur2view.read_image(path)))
        height, width = (4 * side for side in displacement.shape[:2])
        points = grid_points((width, height)).reshape(-1, 2)
        d = displacement.reshape(-1, 2).astype(float)
        columns, rows = np.rint((matches.midpoint - 1.5) / 4).astype(int).T
        along = displacement[np.clip(rows, 0, height // 4 - 1), np.clip(columns, 0, width // 4 - 1)]
        backwards = ((matches.displacement * along).sum(axis=1) < 0)[:, None, None]
        case = Case(
            unordered=matches,
            ordered=np.where(backwards, matches.ends[:, ::-1], matches.ends),
            inlier=None,
            true_ends=smear_ends(points, d)[::7],
            camera=pinhole(truth.K, (width, height)),
            R=relative[:, :3],
            t=relative[:, 3],
        )
        yield "network, true order", case
        yield "network, our order", replace(case, ordered=our_order(case))


def table(judged: dict[tuple[str, str], list[Judged]]) -> str:
    """Return the figures as Markdown: medians over cases, and of F's error the 90 % quantile."""
    head = "matches | method | cases | Sampson px | 90 % | rotation ° | translation ° | precision | recall"
    lines = [f"| {head} | configurations |", "|---" * 10 + "|"]
    for (name, method), cases in judged.items():
        sampson_90 = float(np.quantile([case.sampson_px for case in cases], 0.9, method="higher"))
        figures = [
            float(np.median([getattr(case, key) for case in cases]))
            for key in ("sampson_px", "rotation_deg", "translation_deg", "precision", "recall")
        ]
        figures.insert(1, sampson_90)
        cells = [f"{value:.3f}" if np.isfinite(value) else "-" for value in figures]
        named = Counter(case.config for case in cases if case.config != "-").most_common()
        configurations = ", ".join(f"{config} {count}" for config, count in named)
        lines.append(f"| {name} | {method} | {len(cases)} | {' | '.join(cells)} | {configurations} |")
    return "\n".join(lines) + "\n"


def validate(cases: Iterator[tuple[str, Case]]) -> dict[tuple[str, str], list[Judged]]:
    """Return the figures of every method on every case."""
    judged: dict[tuple[str, str], list[Judged]] = {}
    for name, case in cases:
        for method, solve in METHODS.items():
            judged.setdefault((name, method), []).append(judge(solve(case), case))
    return dict(sorted(judged.items(), key=lambda item: item[0][0]))


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=target, help="write the table here, too")
    parser.add_argument("--sequence", type=existing, help="folder of tools.reconstruction.sequence")
    parser.add_argument("--seeds", type=int, default=len(SEEDS))
    arguments = parser.parse_args()
    judged: dict[Any, list[Judged]] = validate(synthetic_cases(range(arguments.seeds), LENGTHS_PX))
    if arguments.sequence is not None:
        judged |= validate(network_cases(arguments.sequence))
    text = f"{LEGEND}\n\n{table(judged)}"
    print(text, end="")
    if arguments.out is not None:
        arguments.out.write_text(text)


if __name__ == "__main__":
    main()
