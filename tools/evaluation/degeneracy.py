"""How often each of six kinds of scenes is named correctly, and what it is taken for otherwise.

    python -m tools.evaluation.degeneracy --scenes render/test --kinds render/kinds

names 600 synthetic scenes (`degenerate_scenes`), prints a table of the confusions and writes it to
``tools/results/degeneracy.md``; then the same scenes with errors that neighbours share, as a network's, and,
through the network, the photographs of the rendered test split and those of `motion_kinds`.

Rules: a scene with an F is a pure translation if the model is, or if F's rotation is insignificant: smears of
that rotation alone, for the true camera, are in the median shorter than a tenth of the smears, or Schwarz's
criterion does not grant it three parameters (the translation's penalised cost, Akaike's, is above the
model's by less than 3 (ln N - 2)). Else it is general. "open" is PLANAR_OR_PANORAMIC with F and H: parallax
is neither proven nor excluded. That counts as wrong, as PLANAR_OR_PANORAMIC without F does.
"""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

import blur2view
from blur2view.arrays import Array
from blur2view.geometry.epipolar import homogeneous
from blur2view.geometry.pose import essential_motions
from blur2view.geometry.two_view_geometry import Configuration, MotionModel, Parallax, TwoViewGeometry
from blur2view.metrics import rho
from blur2view.robust.homography import transfer_orders
from blur2view.robust.homography_search import find_plane
from blur2view.robust.residuals import WeightedEnds
from blur2view.smears.field import smear_ends
from blur2view.smears.sampling import select_matches
from blur2view.two_view.estimate import estimate_two_view
from tools.arguments import existing, parser_of, target
from tools.datasets import motion_kinds
from tools.datasets.degenerate_scenes import KINDS, DegenerateScene, Kind, draw_scene, smooth_noise
from tools.datasets.testset import TestScene, read_test_set
from tools.evaluation.benchmark import machine
from tools.evaluation.processes import single_threaded_pool

INSIGNIFICANT = 0.1  # smears of the rotation alone over the smears
OUTCOMES = (
    "no motion", "rotation", "plane", "rotation or plane", "open", "translation", "general", "several",
    "undefined",
)  # fmt: skip
RIGHT: dict[Kind, tuple[str, ...]] = {
    "no motion": ("no motion",),
    "pure rotation": ("rotation",),
    "plane": ("plane",),
    "pure translation": ("translation",),
    "general": ("general",),
    "several or none": ("several", "undefined"),
}
STRUCTURES = {"one plane": 0.01, "parallax under 5 %": 0.05, "parallax over 5 %": np.inf}  # of the smears
NAMED = {
    "rotation": Configuration.PANORAMIC,
    "plane": Configuration.PLANAR,
    "still": Configuration.DEGENERATE,
    "general": Configuration.UNCALIBRATED,
}
SHARED_DEG = 4.0
REPORTED = (
    Configuration.UNCALIBRATED,
    Configuration.PLANAR_OR_PANORAMIC,
    Configuration.PLANAR,
    Configuration.PANORAMIC,
    Configuration.MULTIPLE,
    Configuration.DEGENERATE,
    Configuration.UNDEFINED,
)
NAMES = {
    Configuration.DEGENERATE: "no motion",
    Configuration.PANORAMIC: "rotation",
    Configuration.PLANAR: "plane",
    Configuration.MULTIPLE: "several",
    Configuration.UNDEFINED: "undefined",
}


@dataclass(frozen=True, kw_only=True)
class Named:
    """What one scene was and what it was taken for; ``rho`` the median on true smears, nan without F."""

    kind: str
    outcome: str
    rho: float
    seconds: float


def turns(geometry: TwoViewGeometry, F: Array, scene: DegenerateScene) -> bool:
    """Whether F has a significant rotation, by the rules above."""
    costs, points, K = dict(geometry.scores), scene.matches.midpoint, scene.K
    if costs[MotionModel.TRANSLATION] - costs[geometry.model] < 3 * (np.log(len(points)) - 2):
        return False
    (R, _), _ = essential_motions(K.T @ F @ K)
    turned = homogeneous(points) @ (K @ R @ np.linalg.inv(K)).T
    smears = np.linalg.norm(turned[:, :2] / turned[:, 2:] - points, axis=1)
    return bool(np.median(smears) > INSIGNIFICANT * np.median(scene.matches.length_px))


def outcome(geometry: TwoViewGeometry, scene: DegenerateScene) -> str:
    """Return the name of what was found, by the rules above."""
    if geometry.config in NAMES:
        return NAMES[geometry.config]
    if geometry.config is Configuration.PLANAR_OR_PANORAMIC:
        return "rotation or plane" if geometry.F is None else "open"
    assert geometry.F is not None
    return "general" if turns(geometry, geometry.F, scene) else "translation"


def with_shared_errors(scene: DegenerateScene, seed: int, direction_deg: float) -> DegenerateScene:
    """Return smears that err as a network's: correlated over 40 px, lengths by 15 %."""
    rng = np.random.default_rng([seed, 7])
    middle, half = scene.matches.midpoint, 0.5 * scene.matches.displacement
    angle = np.radians(direction_deg) * smooth_noise(rng, middle, 40.0)
    stretch = np.exp(0.15 * smooth_noise(rng, middle, 40.0))[:, None]
    across = half[:, ::-1] * [-1.0, 1.0]
    half = stretch * (np.cos(angle)[:, None] * half + np.sin(angle)[:, None] * across)
    sigma = np.hypot(
        scene.matches.sigma_px, np.hypot(np.radians(direction_deg), 0.15) * scene.matches.length_px
    )
    matches = replace(scene.matches, ends=np.stack([middle - half, middle + half], axis=1), sigma_px=sigma)
    return replace(scene, matches=matches)


def name_scene(task: tuple[Kind, int], direction_deg: float = 0.0) -> Named:
    """Return one random scene, named."""
    kind, seed = task
    scene = draw_scene(kind, seed)
    if direction_deg > 0:
        scene = with_shared_errors(scene, seed, direction_deg)
    start = time.thread_time()
    geometry = estimate_two_view(scene.matches)
    seconds = time.thread_time() - start
    error = np.nan if geometry.F is None else float(np.median(rho(geometry.F, scene.true_ends)))
    return Named(kind=kind, outcome=outcome(geometry, scene), rho=error, seconds=seconds)


def table(rows: list[Named]) -> list[str]:
    """Return confusions as Markdown: one row per kind, one column per outcome, the share named correctly."""
    lines = ["| scene | " + " | ".join(OUTCOMES) + " | correct % |", "|---" * (len(OUTCOMES) + 2) + "|"]
    total = 0
    for kind in KINDS:
        counts = Counter(row.outcome for row in rows if row.kind == kind)
        correct = sum(counts[name] for name in RIGHT[kind])
        total += correct
        cells = [
            f"**{counts[name]}**" if name in RIGHT[kind] else str(counts[name] or "") for name in OUTCOMES
        ]
        lines.append(f"| {kind} | " + " | ".join(cells) + f" | {100 * correct / counts.total():.1f} |")
    return [*lines, f"| all | {'| ' * len(OUTCOMES)}| {100 * total / len(rows):.1f} |"]


def true_structure(scene: TestScene) -> str:
    """Return how far one homography explains the true smears of what stands still in a photograph."""
    if scene.F is None:
        return "pure rotation"
    chosen = scene.valid & scene.static
    points, d = scene.midpoints[chosen], scene.displacement[chosen].astype(float)
    rng = np.random.default_rng(0)
    kept = rng.permutation(len(points))[:1000]
    T = np.linalg.inv(scene.K)
    ends = smear_ends(points[kept], d[kept]) * np.diag(T)[:2] + T[:2, 2]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    matches = WeightedEnds(ends=ends, sigma=0.02 * length + 1e-4)
    plane = find_plane(matches, 3.0, True, rng)
    assert plane is not None
    deviation = 2**0.5 * np.abs(transfer_orders(plane.generator(), matches).least) * matches.sigma
    off = float(np.median(deviation / length))
    return next(name for name, bound in STRUCTURES.items() if off < bound)


def photograph_table(folder: Path) -> list[str]:
    """Return the names that the photographs of a rendered split get through the network."""
    network, rows = blur2view.SmearNetwork(), []
    for scene in read_test_set(folder):
        matches = select_matches(network.predict(blur2view.read_image(scene.image_path)))
        geometry = estimate_two_view(matches)
        rows.append((true_structure(scene), geometry))
    lines = ["| photograph | images | F | H | " + " | ".join(c.name for c in REPORTED) + " |"]
    lines.append("|---" * (len(REPORTED) + 4) + "|")
    for name in ("pure rotation", *STRUCTURES):
        found = [geometry for structure, geometry in rows if structure == name]
        with_F, with_H = (
            sum(x is not None for x in xs) for xs in zip(*((g.F, g.H) for g in found), strict=True)
        )
        counts = [str(sum(g.config is config for g in found) or "") for config in REPORTED]
        lines.append(f"| {name} | {len(found)} | {with_F} | {with_H} | " + " | ".join(counts) + " |")
    return lines


def kinds_table(folder: Path) -> list[str]:
    """Return the names that rendered photographs of four kinds of motion get through the network."""
    network = blur2view.SmearNetwork()
    titles = [c.name for c in REPORTED]
    lines = ["| motion | images | " + " | ".join(titles) + " | parallax proven | correct % |"]
    lines.append("|---" * (len(REPORTED) + 4) + "|")
    for kind in motion_kinds.KINDS:
        found = []
        for scene in read_test_set(folder / kind):
            matches = select_matches(network.predict(blur2view.read_image(scene.image_path)))
            found.append(estimate_two_view(matches))
        right = [geometry.config is NAMED[kind] for geometry in found]
        counts = [sum(geometry.config is config for geometry in found) or "" for config in REPORTED]
        proven = sum(geometry.parallax is Parallax.PROVEN for geometry in found)
        cells = [len(found), *counts, proven, f"{100 * np.mean(right):.0f}" if found else ""]
        lines.append(f"| {kind} | " + " | ".join(str(cell) for cell in cells) + " |")
    return lines


def study(first_seed: int, count: int, jobs: int) -> dict[str, list[Named]]:
    """Return ``count`` named scenes of every kind, with independent and with shared errors."""
    tasks = [(kind, first_seed + i) for kind in KINDS for i in range(count)]
    fewer = [(kind, first_seed + i) for kind in KINDS for i in range(max(count // 5, 1))]
    with single_threaded_pool(jobs) as pool:
        return {
            "independent": pool.map(name_scene, tasks, chunksize=4),
            "shared": pool.map(partial(name_scene, direction_deg=SHARED_DEG), fewer, chunksize=4),
        }


def report(rows: dict[str, list[Named]], photographs: list[str]) -> str:
    """Return the whole page."""
    independent, shared = rows["independent"], rows["shared"]
    ms = 1e3 * float(np.median([row.seconds for row in independent]))
    off = [row for row in independent if row.kind in ("pure rotation", "plane")]
    confident = sum(row.outcome in ("translation", "general") for row in off)
    return "\n".join([
        f"Written by `python -m tools.evaluation.degeneracy`; {machine()}, one thread a scene.", "",
        f"{len(independent)} synthetic scenes: 1000 to 2000 smears of 8 to 40 px, noise 0.25 to 1 px, 0 to "
        "30 % outliers. Bold: correct. Pure rotations and planes that came back as UNCALIBRATED with F: "
        f"{confident} of {len(off)}. Median {ms:.0f} ms a scene.", "",
        *table(independent), "",
        f"{len(shared)} of these scenes with errors that neighbours share besides (direction "
        f"{SHARED_DEG:.0f} degrees, length 15 %, correlated over 40 px). Small parallax cannot be "
        "distinguished from them and is left open.", "",
        *table(shared), "",
        *photographs,
    ])  # fmt: skip


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--count", type=int, default=100, help="scenes of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the first scene of each kind")
    parser.add_argument("--scenes", type=existing, help="rendered split to name through the network")
    parser.add_argument("--kinds", type=existing, help="folder of `motion_kinds`, to name likewise")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=target, default=Path("tools/results/degeneracy.md"))
    options = parser.parse_args()
    photographs = []
    if options.scenes is not None:
        photographs = [
            "Photographs of the rendered test split through the network, by what is true of them. Where an F "
            "has an H beside it parallax is open: errors of the smears and small parallax look alike."
        ]
        photographs += ["", *photograph_table(options.scenes), ""]
    if options.kinds is not None:
        photographs += [
            "Photographs of four kinds of motion (`python -m tools.datasets.motion_kinds`); general motion "
            "has a parallax of at least a fifth of the smears. Correct are PANORAMIC, PLANAR, DEGENERATE "
            "and UNCALIBRATED; beside an F parallax of the first two is open."
        ]
        photographs += ["", *kinds_table(options.kinds), ""]
    page = report(study(options.seed, options.count, options.jobs), photographs)
    options.out.write_text(page)
    print(page)


if __name__ == "__main__":
    main()
