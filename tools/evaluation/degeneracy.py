"""How often six kinds of scenes are named correctly, and what they are taken for otherwise.

``python -m tools.evaluation.degeneracy --kinds render/kinds --out tools/results/degeneracy.md`` names
synthetic scenes (`synthetic_matches.draw_scene`), the same with errors that neighbours share, as a network's,
and, through the network, the photographs of ``tools.datasets.testset --kinds``.
"""

from collections import Counter
from dataclasses import replace
from functools import partial

import numpy as np

import blur2view
from blur2view import Configuration, Parallax, SmearMatches, TwoViewGeometry, estimate_two_view
from blur2view.smears.noise import NoiseModel
from tools.command import Existing, Target, mapped, publish, run, table
from tools.datasets.synthetic_matches import IMAGE_SIZE, SCENES, Scene, draw_scene, with_shared_errors
from tools.datasets.testset import read_test_set

OUTCOMES = {
    Configuration.DEGENERATE: "no motion",
    Configuration.PANORAMIC: "rotation",
    Configuration.PLANAR: "plane",
    Configuration.PLANAR_OR_PANORAMIC: "open",
    Configuration.UNCALIBRATED: "parallax",
    Configuration.UNDEFINED: "undefined",
}
RIGHT = {
    "pure rotation": "rotation", "pure translation": "parallax", "general": "parallax", "still": "no motion",
    "no geometry": "undefined",
}  # fmt: skip
"""The right outcome of a kind of scenes; others are named as their outcome is."""
RENDERED = ("rotation", "plane", "still", "general")
ERRORS = (4.0, 0.15)  # standard deviations that neighbours share: of direction, degrees, and of log length
PATCHES = IMAGE_SIZE[0] * IMAGE_SIZE[1] / (4 * np.pi * 40.0**2)  # of a picture that err independently


def outcome(geometry: TwoViewGeometry) -> str:
    """Return the name of what was found."""
    return OUTCOMES.get(geometry.config, "parallax")


def erring(matches: SmearMatches, seed: int, direction_deg: float, length_share: float) -> SmearMatches:
    """Return smears with errors as a network's: correlated over 40 px, their deviations stated truly."""
    rng, length, turn = np.random.default_rng([seed, 7]), matches.length_px, np.radians(direction_deg)
    in_common = {"length": length_share / PATCHES**0.5, "direction_rad": float(turn) / PATCHES**0.5}
    return replace(
        matches,
        ends=with_shared_errors(matches.ends, rng, direction_deg, length_share),
        sigma_px=np.hypot(matches.sigma_px, np.hypot(turn, length_share) * length),
        across_px=turn * length + matches.sigma_px,
        shared=NoiseModel(effective_share=min(1.0, PATCHES / len(matches)), **in_common),
    )


def name_scene(task: tuple[Scene, int], errors: tuple[float, float] | None) -> tuple[str, str]:
    """Return the kind of a random scene and the outcome, with errors that neighbours share, or without."""
    kind, seed = task
    matches = draw_scene(kind, seed).matches
    return kind, outcome(estimate_two_view(erring(matches, seed, *errors) if errors else matches))


def confusions(rows: list[tuple[str, str]]) -> list[str]:
    """Return a table of kinds and outcomes, the right ones in bold, with the share named correctly."""
    names, lines = list(OUTCOMES.values()), []
    for kind in dict.fromkeys(kind for kind, _ in rows):
        right, counts = RIGHT.get(kind, kind), Counter(found for true, found in rows if true == kind)
        cells = [f"**{counts[name]}**" if name == right else counts[name] or "" for name in names]
        lines.append([kind, counts.total(), *cells, f"{100 * counts[right] / counts.total():.1f}"])
    correct = np.mean([found == RIGHT.get(kind, kind) for kind, found in rows])
    lines.append(["all", len(rows), *[""] * len(names), f"{100 * correct:.1f}"])
    return table(f"scene | number | {' | '.join(names)} | correct %", lines)


def main(
    *,
    count: int = 100,
    seed: int = 0,
    kinds: Existing | None = None,
    jobs: int = 2,
    out: Target | None = None,
) -> None:
    """Name ``count`` scenes of each kind, a fifth as many with shared errors, and photographs."""

    def named(number: int, errors: tuple[float, float] | None) -> list[str]:
        tasks = [(kind, seed + i) for kind in SCENES for i in range(number)]
        return confusions(list(mapped(partial(name_scene, errors=errors), tasks, jobs, 4)))

    blocks = ["## Synthetic scenes", named(count, None)]
    blocks += ["## Errors that neighbours share", named(max(count // 5, 1), ERRORS)]
    if kinds:
        network = blur2view.SmearNetwork()
        scenes = [(kind, scene) for kind in RENDERED for scene in read_test_set(kinds / kind)]
        found = [(kind, blur2view.estimate(scene.image, network=network).geometry) for kind, scene in scenes]
        proven = Counter(kind for kind, one in found if one.parallax is Parallax.PROVEN)
        blocks += ["## Photographs", confusions([(kind, outcome(one)) for kind, one in found])]
        blocks += [f"Parallax is proven in {', '.join(f'{proven[kind]} of {kind}' for kind in RENDERED)}."]
    publish(out, *blocks)


if __name__ == "__main__":
    run(main)
