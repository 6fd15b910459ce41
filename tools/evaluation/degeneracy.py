"""How often each of six kinds of scenes is named correctly, and what it is taken for otherwise.

    python -m tools.evaluation.degeneracy --kinds render/kinds --out tools/results/degeneracy.md

names synthetic scenes (`synthetic_matches.draw_scene`), the same with errors that neighbours share, as a
network's, and, through the network, the photographs of `motion_kinds`.

Rules: UNCALIBRATED is parallax. "open" is PLANAR_OR_PANORAMIC with F and H: parallax is neither proven nor
excluded. That counts as wrong, as PLANAR_OR_PANORAMIC without F does. PANORAMIC and PLANAR count by name,
whether an F stands beside them, which leaves parallax undecided, or not.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import blur2view
from blur2view import Configuration, Parallax, SmearMatches, TwoViewGeometry, estimate_two_view
from blur2view.smears.noise import NoiseModel
from tools.arguments import Existing, Target, run
from tools.datasets.synthetic_matches import SCENES, Scene, draw_scene, with_shared_errors
from tools.datasets.testset import read_test_set
from tools.pages import publish, table
from tools.processes import mapped

NAMES = {
    Configuration.DEGENERATE: "no motion",
    Configuration.PANORAMIC: "rotation",
    Configuration.PLANAR: "plane",
    Configuration.PLANAR_OR_PANORAMIC: "open",
    Configuration.UNCALIBRATED: "parallax",
    Configuration.UNDEFINED: "undefined",
}
OUTCOMES = ("no motion", "rotation", "plane", "rotation or plane", "open", "parallax", "undefined")
RIGHT: dict[Scene, str] = {
    "no motion": "no motion",
    "pure rotation": "rotation",
    "plane": "plane",
    "pure translation": "parallax",
    "general": "parallax",
    "no geometry": "undefined",
}
NAMED = {
    "rotation": Configuration.PANORAMIC,
    "plane": Configuration.PLANAR,
    "still": Configuration.DEGENERATE,
    "general": Configuration.UNCALIBRATED,
}
"""What the photographs of `motion_kinds` are."""
SHARED_DEG, LENGTH_SHARE = 4.0, 0.15
SHARED = NoiseModel(effective_share=0.03, length=0.04, direction_rad=0.02)
"""What errors that are correlated over 40 px have in common."""
INDEPENDENT = (
    "Synthetic scenes: 1000 to 2000 smears of 8 to 40 px, noise 0.25 to 1 px, 0 to 30 % outliers. "
    "Right answers are bold."
)
CORRELATED = (
    f"The same with errors that neighbours share besides (direction {SHARED_DEG:.0f} degrees, length "
    f"{LENGTH_SHARE:.0%}, correlated over 40 px). Small parallax looks the same and is left open."
)
RENDERED = (
    "Photographs of four kinds of motion (`datasets.motion_kinds`); general motion has a parallax of a fifth "
    "of the smears or more. Beside an F parallax of rotations and planes is undecided."
)


def outcome(geometry: TwoViewGeometry) -> str:
    """Return the name of what was found, by the rules above."""
    if geometry.config is Configuration.PLANAR_OR_PANORAMIC and geometry.F is None:
        return "rotation or plane"
    return NAMES.get(geometry.config, "parallax")


def erring(matches: SmearMatches, seed: int, direction_deg: float) -> SmearMatches:
    """Return smears that err as a network's: correlated over 40 px, lengths by 15 %, stated truly."""
    ends = with_shared_errors(matches.ends, np.random.default_rng([seed, 7]), direction_deg, LENGTH_SHARE)
    sigma = np.hypot(matches.sigma_px, np.hypot(np.radians(direction_deg), LENGTH_SHARE) * matches.length_px)
    across = np.radians(direction_deg) * matches.length_px + matches.sigma_px
    return replace(matches, ends=ends, sigma_px=sigma, across_px=across, shared=SHARED)


def name_scene(task: tuple[Scene, int], direction_deg: float) -> tuple[Scene, str]:
    """Return what one random scene is and what it is taken for."""
    kind, seed = task
    matches = draw_scene(kind, seed).matches
    if direction_deg > 0:
        matches = erring(matches, seed, direction_deg)
    return kind, outcome(estimate_two_view(matches))


def confusions(rows: list[tuple[Scene, str]]) -> list[str]:
    """Return confusions as Markdown: one row per kind, one column per outcome, the share named correctly."""
    lines = []
    for kind in SCENES:
        counts = Counter(found for true, found in rows if true == kind)
        cells = [f"**{counts[n]}**" if n == RIGHT[kind] else str(counts[n] or "") for n in OUTCOMES]
        lines.append([kind, *cells, f"{100 * counts[RIGHT[kind]] / counts.total():.1f}"])
    right = np.mean([found == RIGHT[true] for true, found in rows])
    return table(
        f"scene | {' | '.join(OUTCOMES)} | correct %",
        [*lines, ["all", *[""] * len(OUTCOMES), f"{100 * right:.1f}"]],
    )


def photograph_rows(folder: Path) -> Iterator[list[object]]:
    """Yield how often photographs of each kind of motion get each name, and are said to have parallax."""
    network = blur2view.SmearNetwork()
    for kind, config in NAMED.items():
        found = [
            blur2view.estimate(one.image, network=network).geometry for one in read_test_set(folder / kind)
        ]
        counts = Counter(geometry.config for geometry in found)
        proven = sum(geometry.parallax is Parallax.PROVEN for geometry in found)
        yield [
            kind,
            len(found),
            *(counts[one] or "" for one in NAMES),
            proven,
            f"{100 * counts[config] / len(found):.0f}",
        ]


def main(
    *,
    count: int = 100,
    seed: int = 0,
    kinds: Existing | None = None,
    jobs: int = 2,
    out: Target | None = None,
) -> None:
    """Name ``count`` scenes of each kind, a fifth as many with shared errors, and photographs."""

    def named(number: int, direction_deg: float) -> list[str]:
        tasks = [(kind, seed + i) for kind in SCENES for i in range(number)]
        return confusions(list(mapped(partial(name_scene, direction_deg=direction_deg), tasks, jobs, 4)))

    blocks = [INDEPENDENT, named(count, 0.0), CORRELATED, named(max(count // 5, 1), SHARED_DEG)]
    if kinds:
        head = f"photographs | images | {' | '.join(one.name for one in NAMES)} | parallax proven | correct %"
        blocks += [RENDERED, table(head, photograph_rows(kinds))]
    publish(out, *blocks)


if __name__ == "__main__":
    run(main)
