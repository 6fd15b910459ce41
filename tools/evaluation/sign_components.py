"""How far sign components cut the work of a minimal sample, how often they are right, what a wrong one costs.

    python -m tools.evaluation.sign_components --scenes render/test --redkitchen ../shared/data/redkitchen

prints two tables and writes them to ``tools/results/sign_components.md``. Figures on frames of
``../shared/data`` are marked: those frames are not part of the project.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np

import blur2view
from blur2view.arrays import AnyArray
from blur2view.metrics import rho
from blur2view.robust.minimal_solvers import ALL_SIGNS, SAMPLE_SIZE, solve_seven_smears
from blur2view.robust.ransac import ransac, weighted_samples
from blur2view.smears.field import SmearField
from blur2view.smears.matches import SmearMatches
from blur2view.smears.sampling import select_matches
from blur2view.smears.sign_components import SignComponents, no_components, sample_patterns, sign_components
from blur2view.two_view.model_selection import fit_families
from blur2view.two_view.options import EstimatorOptions
from blur2view.two_view.search import build_estimator
from tools.arguments import existing, parser_of, target
from tools.datasets.synthetic_matches import SyntheticOptions, SyntheticSmears, synthetic_smears
from tools.datasets.testset import read_test_set
from tools.evaluation.benchmark import machine

SAMPLES = 200  # samples of seven per image
REPEATS = 5  # timings per image, of which the median counts
MIN_LENGTH_PX = 3.0  # true smears at least this long tell an order
AGREE = 0.7  # |cos| between a smear and the truth from which it counts as a smear of the camera's motion
SYNTHETIC = {
    "synthetic, smooth depth, no noise": SyntheticOptions(noise_px=0.0, outliers=0.0),
    "synthetic, smooth, 1 px, 30 % outliers": SyntheticOptions(),
    "synthetic, smooth, 1 px, 60 % outliers": SyntheticOptions(outliers=0.6),
    "synthetic, smooth, 1 px, 30 % second motion": SyntheticOptions(outliers=0.0, second_motion=0.3),
    "synthetic, scattered depth, no noise": SyntheticOptions(kind="scattered", noise_px=0.0, outliers=0.0),
    "synthetic, scattered, 1 px, 30 % outliers": SyntheticOptions(kind="scattered"),
}
WRONG = {
    "smooth, 1 px, 30 % outliers": SyntheticOptions(),
    "scattered, 1 px, 30 % outliers": SyntheticOptions(kind="scattered"),
}


@dataclass(frozen=True, kw_only=True)
class Case:
    """Matches whose true order is known: +1 where ends[:, 0] is the open end, 0 where nothing is known."""

    matches: SmearMatches
    order: AnyArray


@dataclass(frozen=True, kw_only=True)
class Figures:
    """What components do on one image; shares are of its smears, times in milliseconds.

    ``wrong`` the share of the smears of known order that contradict the majority of their component;
    ``patterns`` (SAMPLES,) the sign patterns left of samples drawn as the estimator draws them;
    ``seconds_all`` and ``seconds_left`` what solving the samples takes with all patterns and with those left.
    """

    alone: float
    largest: float
    three: float
    wrong: float
    patterns: AnyArray
    milliseconds: float
    seconds_all: float
    seconds_left: float


def synthetic_cases(options: SyntheticOptions, count: int) -> Iterator[Case]:
    """Yield scenes of seeds 0, 1, ...; outliers have no order."""
    for seed in range(count):
        scene = synthetic_smears(seed, options)
        yield Case(
            matches=scene.matches, order=np.where(scene.outlier, 0.0, np.where(scene.swapped, -1.0, 1.0))
        )


def field_case(field: SmearField, truth: AnyArray, measurable: AnyArray) -> Case:
    """Return a field's matches; orders from true displacements (h, w, 2), stride 4, where measurable."""
    matches = select_matches(field)
    columns, rows = np.floor(matches.midpoint / 4).astype(int).T
    true = np.where(measurable[..., None], truth, 0).astype(np.float64)[rows, columns]
    dot, length = (true * matches.displacement).sum(axis=1), np.hypot(*true.T)
    known = (length >= MIN_LENGTH_PX) & (np.abs(dot) > AGREE * length * matches.length_px)
    return Case(matches=matches, order=np.where(known, np.sign(dot), 0.0))


def rendered_cases(folder: Path) -> Iterator[Case]:
    """Yield the rendered test split, smears by the shipped network."""
    network = blur2view.SmearNetwork()
    for scene in read_test_set(folder):
        field = network.predict(blur2view.read_image(scene.image_path))
        yield field_case(field, scene.displacement, scene.valid & scene.static)


def redkitchen_cases(folder: Path) -> Iterator[Case]:
    """Yield the real frames, smears by the shipped network."""
    network = blur2view.SmearNetwork()
    for path in sorted(folder.glob("*.npz")):
        with np.load(path) as stored:
            flow, valid = stored["flow"], stored["valid"]
        yield field_case(network.predict(blur2view.read_image(path.with_suffix(".jpg"))), flow, valid)


def measure(case: Case) -> Figures:
    """Return how one image's smears are grouped, how well, and what that leaves of samples."""
    timings = []
    for _ in range(REPEATS):
        start = time.thread_time()
        components = sign_components(case.matches)
        timings.append(time.thread_time() - start)
    estimator = build_estimator(case.matches, EstimatorOptions())
    drawn = weighted_samples(estimator.quality, SAMPLE_SIZE, SAMPLES, np.random.default_rng(0))
    ends, groups = case.matches.ends, sample_patterns(components, drawn)
    start = time.thread_time()
    solve_seven_smears(ends[drawn], ALL_SIGNS)
    middle = time.thread_time()
    for group in groups:
        solve_seven_smears(ends[drawn[group.index]], group.signs)
    sizes = components.sizes / len(components)
    return Figures(
        alone=float((components.sizes[components.label] == 1).mean()),
        largest=float(sizes[0]),
        three=float(sizes[:3].sum()),
        wrong=wrong_share(components, case.order),
        patterns=2.0 ** (components.touched(drawn) - 1),
        milliseconds=1e3 * median(timings),
        seconds_all=middle - start,
        seconds_left=time.thread_time() - middle,
    )


def wrong_share(components: SignComponents, order: AnyArray) -> float:
    """Return the share of the smears of known order (N,) that contradict the majority of their component."""
    known = order != 0
    if not known.any():
        return 0.0
    net = np.bincount(components.label[known], weights=(order * components.sign)[known])
    return float(0.5 * (1 - np.abs(net).sum() / known.sum()))


def study_row(name: str, cases: Iterator[Case]) -> str:
    """Return one row of the first table: means over images, unless said otherwise."""
    found = [measure(case) for case in cases if len(case.matches) >= EstimatorOptions().min_matches]
    patterns = np.concatenate([figures.patterns for figures in found])
    wrong = np.array([figures.wrong for figures in found])
    mean = {
        key: 100 * float(np.mean([getattr(f, key) for f in found])) for key in ("alone", "largest", "three")
    }
    ratio = sum(f.seconds_left for f in found) / sum(f.seconds_all for f in found)
    return (
        f"| {name} | {len(found)} | {mean['alone']:.1f} | {mean['largest']:.0f} | {mean['three']:.0f} "
        f"| {100 - 100 * wrong.mean():.2f} | {100 - 100 * wrong.max():.1f} "
        f"| {np.median(patterns):.0f} | {patterns.mean():.1f} | {100 * (patterns <= 4).mean():.0f} "
        f"| {ratio:.2f} | {median(f.milliseconds for f in found):.1f} |"
    )


def groupings(scene: SyntheticSmears) -> dict[str, SignComponents]:
    """Return groupings, from the one found to deliberately wrong ones of all smears in one component."""
    count, rng = len(scene.swapped), np.random.default_rng(0)
    true, one = np.where(scene.swapped, -1.0, 1.0), np.zeros(count, int)
    left = scene.matches.midpoint[:, 0] < np.median(scene.matches.midpoint[:, 0])
    return {
        "as found": sign_components(scene.matches),
        "none": no_components(count),
        "one component, the true signs": SignComponents(label=one, sign=true),
        "one component, 30 % of the signs wrong": SignComponents(
            label=one, sign=np.where(rng.random(count) < 0.3, -true, true)
        ),
        "one component, the left half wrong": SignComponents(label=one, sign=np.where(left, -true, true)),
        "one component, random signs": SignComponents(label=one, sign=rng.choice([-1.0, 1.0], count)),
    }


def accuracy(scene: SyntheticSmears, components: SignComponents) -> tuple[float, float]:
    """Return the median rho of the F found with a grouping, and CPU milliseconds without the grouping."""
    options, rng = EstimatorOptions(), np.random.default_rng(0)
    estimator = replace(build_estimator(scene.matches, options), components=components)
    start = time.thread_time()
    problem, fits = fit_families(estimator, ransac(estimator, options.search(), rng), rng)
    milliseconds = 1e3 * (time.thread_time() - start)
    F = problem.pixels(min(fits, key=lambda fit: fit.score).point.matrix())
    return float(np.median(rho(F, scene.true_ends))), milliseconds


def wrong_rows(name: str, options: SyntheticOptions, count: int) -> Iterator[str]:
    """Yield rows of the second table: what each grouping costs."""
    table: dict[str, list[tuple[float, float]]] = {}
    for seed in range(count):
        scene = synthetic_smears(seed, options)
        for grouping, components in groupings(scene).items():
            table.setdefault(grouping, []).append(accuracy(scene, components))
    for grouping, found in table.items():
        value, milliseconds = np.array(found).T
        yield (
            f"| {name} | {grouping} | {np.median(value):.4f} | {value.mean():.4f} "
            f"| {100 * (value < 0.05).mean():.0f} | {np.median(milliseconds):.0f} |"
        )


def report(scenes: Path | None, redkitchen: Path | None, count: int) -> str:
    """Return both tables as Markdown."""
    rows = [study_row(name, synthetic_cases(options, count)) for name, options in SYNTHETIC.items()]
    if scenes is not None:
        rows.append(study_row("network, rendered test split", rendered_cases(scenes)))
    if redkitchen is not None:
        rows.append(study_row("network, RedKitchen (rests on ../shared)", redkitchen_cases(redkitchen)))
    wrong = [row for name, options in WRONG.items() for row in wrong_rows(name, options, count)]
    return "\n".join([
        f"Written by `python -m tools.evaluation.sign_components`; {machine()}, CPU times of one thread.",
        "",
        "Components of up to 2000 smears (1000 synthetic ones), means over images. Alone: share of smears in "
        "a component of their own. Signs right: share of the smears of known order that agree with the "
        "majority of their component. Patterns: sign patterns left of 64, samples of seven drawn as the "
        "estimator draws them. Solver: its time with the patterns left over that with all 64. "
        "ms: grouping one image.",
        "",
        "| field | images | alone % | largest % | largest three % | signs right % | in the worst image "
        "| patterns, median | mean | at most 4, % | solver | ms |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
        *rows,
        "",
        f"What a wrong grouping costs: {count} synthetic scenes, image size known, rho on the true smears.",
        "",
        "| scenes | grouping | median rho | mean rho | under 0.05, % | ms, search and fit |",
        "|---|---|---|---|---|---|",
        *wrong,
        "",
    ])  # fmt: skip


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--scenes", type=existing, help="folder of the rendered test split")
    parser.add_argument("--redkitchen", type=existing, help="folder of the real frames")
    parser.add_argument("--count", type=int, default=40, help="synthetic scenes per row")
    parser.add_argument("--out", type=target, default=Path("tools/results/sign_components.md"))
    arguments = parser.parse_args()
    text = report(arguments.scenes, arguments.redkitchen, arguments.count)
    print(text)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(text)


if __name__ == "__main__":
    main()
