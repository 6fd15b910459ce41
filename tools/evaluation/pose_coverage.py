"""How often the 90 % regions of poses hold the truth, for independent and for correlated errors.

    python -m tools.evaluation.pose_coverage --out tools/results/pose_coverage

Synthetic smears with known intrinsics (`synthetic_matches`), solved by ``estimate_two_view`` from
smears without order. "white": 1 px of noise on every coordinate, standard deviations stated truly, with and
without outliers. "correlated": directions and lengths err as one over 40 px, as those of a network;
the standard deviation of every displacement is stated truly, that errors are correlated is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import get_args

import numpy as np

from blur2view.camera.camera import Camera
from blur2view.geometry.pose import CHI_SQUARED_90, RigidTransform
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.estimate import estimate_two_view
from tools.arguments import parser_of, target
from tools.datasets.degenerate_scenes import with_shared_errors
from tools.datasets.synthetic_matches import (
    IMAGE_SIZE,
    Kind,
    SyntheticOptions,
    SyntheticSmears,
    synthetic_smears,
)
from tools.evaluation.processes import single_threaded_pool
from tools.metrics import rotation_error, translation_direction_error_deg

SEEDS = 200
PARTS = {"pose": slice(0, 5), "rotation": slice(0, 3), "translation": slice(3, 5)}


@dataclass(frozen=True, kw_only=True)
class Case:
    """A kind of scene and of noise: outliers' share, or the direction's and the length's errors."""

    name: str
    kind: Kind
    outliers: float = 0.0
    direction_deg: float = 0.0
    length_share: float = 0.0


KINDS: tuple[Kind, ...] = get_args(Kind)
CASES = (
    *(
        Case(name=f"white, {kind} depth{', 30 % outliers' * bool(share)}", kind=kind, outliers=share)
        for kind in KINDS
        for share in (0.0, 0.3)
    ),
    *(
        Case(
            name=f"correlated, {kind} depth, {degrees} degrees, {length:.0%}".replace("%", " %"),
            kind=kind,
            direction_deg=degrees,
            length_share=length,
        )
        for kind, degrees, length in ((KINDS[0], 2, 0.05), *((kind, 4, 0.1) for kind in KINDS))
    ),
)


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Which regions held the truth (pose, rotation, translation), and the errors; None without a pose."""

    case: Case
    held: tuple[bool, bool, bool] | None
    rotation: float = float("nan")  # relative
    translation_deg: float = float("nan")


def observed(seed: int, case: Case) -> tuple[SyntheticSmears, SmearMatches]:
    """Return the smears of a seed, and what is seen of them."""
    if not case.direction_deg:
        scene = synthetic_smears(seed, SyntheticOptions(kind=case.kind, outliers=case.outliers))
        return scene, scene.matches
    scene = synthetic_smears(seed, SyntheticOptions(kind=case.kind, outliers=0.0, noise_px=0.0))
    rng = np.random.default_rng([seed, 1])
    ends = with_shared_errors(scene.ends, rng, case.direction_deg, case.length_share)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    sigma_px = np.maximum(length * np.hypot(np.radians(case.direction_deg), case.length_share), 1e-2)
    return scene, SmearMatches(ends=ends, sigma_px=sigma_px, image_size=IMAGE_SIZE)


def outcome(case: Case, seed: int) -> Outcome:
    """Return whether the regions of one seed hold its pose."""
    scene, matches = observed(seed, case)
    camera = Camera(K=scene.K, width=IMAGE_SIZE[0], height=IMAGE_SIZE[1])
    geometry = estimate_two_view(matches, camera=camera)
    pose, covariance = geometry.cam2_from_cam1, geometry.covariance
    if pose is None or covariance is None or not pose.translation.any():
        return Outcome(case=case, held=None)
    true = RigidTransform(rotation=scene.R, translation=scene.t / np.linalg.norm(scene.t))
    pose_held, rotation_held, translation_held = (
        covariance.squared_distance(pose, true, part) < CHI_SQUARED_90[part.stop - part.start]
        for part in PARTS.values()
    )
    return Outcome(
        case=case,
        held=(pose_held, rotation_held, translation_held),
        rotation=rotation_error(pose.rotation, scene.R)[1],
        translation_deg=translation_direction_error_deg(pose.translation, scene.t),
    )


def markdown(outcomes: Sequence[Outcome], seeds: int) -> str:
    """Return a table of the shares of seeds whose regions hold the truth."""
    rows = [
        f"Share of seeds 0 to {seeds - 1} whose nominal 90 % region holds the truth, and median errors.",
        "",
        "| smears | poses | pose | rotation | translation | rotation error | translation error, degrees |",
        "|---|---|---|---|---|---|---|",
    ]
    for case in CASES:
        found = [o for o in outcomes if o.case == case and o.held is not None]
        held = np.array([o.held for o in found]).reshape(-1, len(PARTS)).mean(axis=0)
        shares = " | ".join(f"{share:.2f}" for share in held)
        rotation = np.median([o.rotation for o in found])
        translation = np.median([o.translation_deg for o in found])
        rows.append(f"| {case.name} | {len(found)} | {shares} | {rotation:.0%} | {translation:.1f} |")
    return "\n".join([*rows, ""])


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=target, help="write the table to OUT.md")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    outcomes: list[Outcome] = []
    with single_threaded_pool(arguments.jobs) as pool:
        for case in CASES:
            outcomes += pool.map(partial(outcome, case), range(arguments.seeds))
    table = markdown(outcomes, arguments.seeds)
    print(table)
    if arguments.out is not None:
        arguments.out.with_suffix(".md").write_text(table)


if __name__ == "__main__":
    main()
