"""How often each of six kinds of scenes is named correctly, and what it is taken for otherwise.

``python -m tools.evaluation.degeneracy --kinds render/kinds --out tools/results/degeneracy.md`` names
synthetic scenes (`synthetic_matches.draw_scene`), the same with errors that neighbours share, as a network's,
and, through the network, the photographs of ``tools.datasets.testset --kinds``.

"open" is PLANAR_OR_PANORAMIC: parallax is neither proven nor excluded, which counts as wrong. PANORAMIC and
PLANAR count by name, whether an F stands beside them, which leaves parallax undecided, or not.
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
OUTCOMES = tuple(NAMES.values())
RIGHT = dict(
    zip(SCENES, ("no motion", "rotation", "plane", "parallax", "parallax", "undefined"), strict=True)
)
NAMED = {"rotation": "rotation", "plane": "plane", "still": "no motion", "general": "parallax"}
"""What the rendered kinds are."""
SHARED_DEG, LENGTH_SHARE = 4.0, 0.15
SHARED = NoiseModel(effective_share=0.03, length=0.04, direction_rad=0.02)
"""What errors that are correlated over 40 px have in common."""
WORDS = (
    "Synthetic scenes: 1000 to 2000 smears of 8 to 40 px, noise 0.25 to 1 px, 0 to 30 % outliers. "
    "Right answers are bold.",
    f"The same with errors that neighbours share besides (direction {SHARED_DEG:.0f} degrees, length "
    f"{LENGTH_SHARE:.0%}, correlated over 40 px). Small parallax looks the same and is left open.",
    "Photographs of four kinds of motion; general motion has a parallax of a fifth of the smears or more.",
)


def outcome(geometry: TwoViewGeometry) -> str:
    """Return the name of what was found."""
    return NAMES.get(geometry.config, "parallax")


def erring(matches: SmearMatches, seed: int, direction_deg: float) -> SmearMatches:
    """Return smears that err as a network's: correlated over 40 px, lengths by 15 %, stated truly."""
    ends = with_shared_errors(matches.ends, np.random.default_rng([seed, 7]), direction_deg, LENGTH_SHARE)
    sigma = np.hypot(matches.sigma_px, np.hypot(np.radians(direction_deg), LENGTH_SHARE) * matches.length_px)
    across = np.radians(direction_deg) * matches.length_px + matches.sigma_px
    return replace(matches, ends=ends, sigma_px=sigma, across_px=across, shared=SHARED)


def name_scene(task: tuple[Scene, int], direction_deg: float) -> tuple[str, str]:
    """Return what one random scene is and what it is taken for."""
    kind, seed = task
    matches = draw_scene(kind, seed).matches
    if direction_deg > 0:
        matches = erring(matches, seed, direction_deg)
    return kind, outcome(estimate_two_view(matches))


def confusions(rows: list[tuple[str, str]], right: dict[str, str]) -> list[str]:
    """Return confusions as Markdown: one row per kind, one column per outcome, the share named correctly."""
    lines: list[list[object]] = []
    for kind in dict.fromkeys(true for true, _ in rows):
        counts = Counter(found for true, found in rows if true == kind)
        cells = [f"**{counts[n]}**" if n == right[kind] else counts[n] or "" for n in OUTCOMES]
        lines.append([kind, counts.total(), *cells, f"{100 * counts[right[kind]] / counts.total():.1f}"])
    correct = np.mean([found == right[true] for true, found in rows])
    lines.append(["all", len(rows), *[""] * len(OUTCOMES), f"{100 * correct:.1f}"])
    return table(f"scene | number | {' | '.join(OUTCOMES)} | correct %", lines)


def rendered(folder: Path) -> Iterator[tuple[str, TwoViewGeometry]]:
    """Yield what is found in photographs of each kind of motion."""
    network = blur2view.SmearNetwork()
    for kind in NAMED:
        for scene in read_test_set(folder / kind):
            yield kind, blur2view.estimate(scene.image, network=network).geometry


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
        found = mapped(partial(name_scene, direction_deg=direction_deg), tasks, jobs, 4)
        return confusions(list(found), {str(kind): name for kind, name in RIGHT.items()})

    blocks = [WORDS[0], named(count, 0.0), WORDS[1], named(max(count // 5, 1), SHARED_DEG)]
    if kinds:
        found = list(rendered(kinds))
        proven = Counter(kind for kind, one in found if one.parallax is Parallax.PROVEN)
        said = ", ".join(f"{proven[kind]} of {kind}" for kind in NAMED)
        blocks += [WORDS[2], confusions([(kind, outcome(one)) for kind, one in found], NAMED)]
        blocks += [f"Parallax is proven in {said}."]
    publish(out, *blocks)


if __name__ == "__main__":
    run(main)
