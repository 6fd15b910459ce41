"""How often each of six kinds of scenes is named correctly, and what it is taken for otherwise.

    python -m tools.evaluation.degeneracy --scenes render/test --kinds render/kinds

names 600 synthetic scenes (`degenerate_scenes`), prints a table of the confusions and writes it to
``tools/results/degeneracy.md``; then the same scenes with errors that neighbours share, as a network's, and,
through the network, the photographs of the rendered test split and those of `motion_kinds`.

Rules: UNCALIBRATED is parallax. "open" is PLANAR_OR_PANORAMIC with F and H: parallax is neither proven nor
excluded. That counts as wrong, as PLANAR_OR_PANORAMIC without F does. PANORAMIC and PLANAR count by name,
whether an F stands beside them, which leaves parallax undecided, or not.
"""

from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import blur2view
from blur2view import Configuration, Parallax, TwoViewGeometry, estimate_two_view
from blur2view.smears.noise import NoiseModel
from tools.arguments import Existing, Target, run
from tools.datasets import motion_kinds
from tools.datasets.degenerate_scenes import KINDS, Kind, draw_scene, with_shared_errors
from tools.datasets.synthetic_matches import KnownMatches
from tools.datasets.testset import TestScene, read_test_set
from tools.pages import joined, publish, table
from tools.processes import mapped

OUTCOMES = (
    "no motion", "rotation", "plane", "rotation or plane", "open", "parallax", "undefined",
)  # fmt: skip
RIGHT: dict[Kind, tuple[str, ...]] = {
    "no motion": ("no motion",),
    "pure rotation": ("rotation",),
    "plane": ("plane",),
    "pure translation": ("parallax",),
    "general": ("parallax",),
    "no geometry": ("undefined",),
}
STRUCTURES = {"one plane": 0.01, "parallax under 5 %": 0.05, "parallax over 5 %": np.inf}  # of the smears
NAMED = {
    "rotation": Configuration.PANORAMIC,
    "plane": Configuration.PLANAR,
    "still": Configuration.DEGENERATE,
    "general": Configuration.UNCALIBRATED,
}
SHARED_DEG, LENGTH_SHARE = 4.0, 0.15
NAMES = {
    Configuration.PLANAR: "plane",
    Configuration.PANORAMIC: "rotation",
    Configuration.DEGENERATE: "no motion",
    Configuration.UNDEFINED: "undefined",
}
REPORTED = (Configuration.UNCALIBRATED, Configuration.PLANAR_OR_PANORAMIC, *NAMES)
ALIKE = NoiseModel(effective_share=0.03, length=0.04, direction_rad=0.02)
"""What errors that are correlated over 40 px have in common."""


Named = tuple[str, str]
"""What a scene was and what it was taken for."""


def outcome(geometry: TwoViewGeometry) -> str:
    """Return the name of what was found, by the rules above."""
    if geometry.config in NAMES:
        return NAMES[geometry.config]
    if geometry.config is Configuration.PLANAR_OR_PANORAMIC:
        return "rotation or plane" if geometry.F is None else "open"
    return "parallax"


def erring(scene: KnownMatches, seed: int, direction_deg: float) -> KnownMatches:
    """Return smears that err as a network's: correlated over 40 px, lengths by 15 %, stated truly."""
    found = scene.matches
    ends = with_shared_errors(found.ends, np.random.default_rng([seed, 7]), direction_deg, LENGTH_SHARE)
    sigma = np.hypot(found.sigma_px, np.hypot(np.radians(direction_deg), LENGTH_SHARE) * found.length_px)
    across = np.radians(direction_deg) * found.length_px + found.sigma_px
    matches = replace(found, ends=ends, sigma_px=sigma, across_px=across, shared=ALIKE)
    return replace(scene, matches=matches)


def name_scene(task: tuple[Kind, int], direction_deg: float = 0.0) -> Named:
    """Return one random scene, named."""
    kind, seed = task
    scene = draw_scene(kind, seed)
    if direction_deg > 0:
        scene = erring(scene, seed, direction_deg)
    return kind, outcome(estimate_two_view(scene.matches))


def confusions(rows: list[Named]) -> list[str]:
    """Return confusions as Markdown: one row per kind, one column per outcome, the share named correctly."""
    lines, total = [], 0
    for kind in KINDS:
        counts = Counter(found for true, found in rows if true == kind)
        correct = sum(counts[name] for name in RIGHT[kind])
        total += correct
        cells = [f"**{counts[n]}**" if n in RIGHT[kind] else str(counts[n] or "") for n in OUTCOMES]
        lines.append([kind, *cells, f"{100 * correct / counts.total():.1f}"])
    lines.append(["all", *[""] * len(OUTCOMES), f"{100 * total / len(rows):.1f}"])
    return table(f"scene | {' | '.join(OUTCOMES)} | correct %", lines)


def true_structure(scene: TestScene) -> str:
    """Return how far one homography explains the true smears of what stands still in a photograph."""
    if scene.F is None:
        return "pure rotation"
    deviation, length = motion_kinds.off_plane(scene.displacement, scene.valid & scene.static, scene.K)
    off = float(np.median(deviation / length))
    return next(name for name, bound in STRUCTURES.items() if off < bound)


def photograph_table(groups: dict[str, list[TestScene]], network: blur2view.SmearNetwork) -> list[str]:
    """Return the verdicts on photographs as Markdown, a row for each kind."""
    rows = []
    for name, scenes in groups.items():
        found = [blur2view.estimate(scene.image, network=network).geometry for scene in scenes]
        counts = [sum(g.config is config for g in found) or "" for config in REPORTED]
        proven = sum(g.parallax is Parallax.PROVEN for g in found)
        right = [g.config is NAMED[name] for g in found] if name in NAMED else []
        rows.append([name, len(found), *counts, proven, f"{100 * np.mean(right):.0f}" if right else ""])
    configs = " | ".join(config.name for config in REPORTED)
    return table(f"photographs | images | {configs} | parallax proven | correct %", rows)


def report(independent: list[Named], shared: list[Named], photographs: dict[str, list[str]]) -> str:
    """Return the whole page; ``photographs`` are tables by what stands over them."""
    off = [found for true, found in independent if true in ("pure rotation", "plane")]
    confident = off.count("parallax")
    return joined(
        "Written by `python -m tools.evaluation.degeneracy`.",
        f"{len(independent)} synthetic scenes: 1000 to 2000 smears of 8 to 40 px, noise 0.25 to 1 px, 0 to "
        "30 % outliers. Bold: correct. Pure rotations and planes that came back as UNCALIBRATED with F: "
        f"{confident} of {len(off)}.",
        confusions(independent),
        f"{len(shared)} of these scenes with errors that neighbours share besides (direction "
        f"{SHARED_DEG:.0f} degrees, length 15 %, correlated over 40 px). Small parallax cannot be "
        "distinguished from them and is left open.",
        confusions(shared),
        *(block for pair in photographs.items() for block in pair),
    )


def main(
    *,
    count: int = 100,
    seed: int = 0,
    scenes: Existing | None = None,
    kinds: Existing | None = None,
    jobs: int = 2,
    out: Target = Path("tools/results/degeneracy.md"),
) -> None:
    """Name ``count`` scenes of each kind, a rendered split, and photographs of `motion_kinds`."""
    photographs: dict[str, list[str]] = {}
    network = blur2view.SmearNetwork()
    if scenes is not None:
        split: dict[str, list[TestScene]] = {name: [] for name in ("pure rotation", *STRUCTURES)}
        for scene in read_test_set(scenes):
            split[true_structure(scene)].append(scene)
        title = "Photographs of the rendered test split, by what is true of them."
        photographs[title] = photograph_table(split, network)
    if kinds is not None:
        title = (
            "Photographs of four kinds of motion (`python -m tools.datasets.motion_kinds`); general motion "
            "has a parallax of at least a fifth of the smears. Correct are PANORAMIC, PLANAR, DEGENERATE "
            "and UNCALIBRATED; beside an F parallax of the first two is undecided."
        )
        groups = {kind: read_test_set(kinds / kind) for kind in motion_kinds.KINDS}
        photographs[title] = photograph_table(groups, network)

    def named(number: int, direction_deg: float) -> list[Named]:
        tasks = [(kind, seed + i) for kind in KINDS for i in range(number)]
        return list(mapped(partial(name_scene, direction_deg=direction_deg), tasks, jobs, 4))

    publish(report(named(count, 0.0), named(max(count // 5, 1), SHARED_DEG), photographs), out)


if __name__ == "__main__":
    run(main)
