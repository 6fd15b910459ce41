"""How often the 90 % regions of poses hold the truth, for independent errors and for those neighbours share.

``python -m tools.evaluation.pose_coverage --out tools/results/pose_coverage.md`` estimates poses of synthetic
smears without order (`synthetic_matches`), the camera given. "white": 1 px of noise on every coordinate.
"correlated": directions and lengths err as a network's (`degeneracy.erring`). Deviations are stated truly.
"""

from functools import partial
from typing import get_args

import numpy as np

from blur2view import RigidTransform, estimate_two_view
from tools.command import Target, mapped, publish, run, table
from tools.datasets.synthetic_matches import Kind, SyntheticOptions, synthetic_smears
from tools.evaluation.baselines import camera_of
from tools.evaluation.degeneracy import erring
from tools.metrics import CHI_SQUARED_90, rotation_error, squared_distance, translation_direction_error_deg

PARTS = slice(0, 5), slice(0, 3), slice(3, 5)  # of the pose: all, rotation, translation
BOUNDS = [CHI_SQUARED_90[part.stop - part.start] for part in PARTS]
HEAD = "smears | poses | pose | rotation | translation | rotation error | translation error, degrees"
CORRELATED: tuple[tuple[Kind, float, float], ...] = (
    ("smooth", 2.0, 0.05), ("smooth", 4.0, 0.1), ("scattered", 4.0, 0.1),
)  # fmt: skip
CASES: dict[str, tuple[SyntheticOptions, tuple[float, float] | None]] = {
    f"white, {kind} depth, {share:.0%} outliers": (SyntheticOptions(kind=kind, outliers=share), None)
    for kind in get_args(Kind)
    for share in (0.0, 0.3)
} | {
    f"correlated, {kind} depth, {degrees:g} degrees, {share:.0%}": (
        SyntheticOptions(kind=kind, outliers=0.0, noise_px=0.0), (degrees, share)
    )
    for kind, degrees, share in CORRELATED
}  # fmt: skip
"""The smears, and the errors of direction (degrees) and length that neighbours share."""


def outcome(seed: int, name: str) -> list[float] | None:
    """Return the squared distances of one seed's pose by PARTS, and its errors; None without a pose."""
    options, errors = CASES[name]
    scene = synthetic_smears(seed, options)
    matches = erring(scene.matches, seed, *errors) if errors else scene.matches
    geometry = estimate_two_view(matches, camera=camera_of(scene))
    pose, covariance = geometry.cam2_from_cam1, geometry.covariance
    if pose is None or covariance is None or not pose.translation.any():
        return None
    true = RigidTransform(rotation=scene.R, translation=scene.t / np.linalg.norm(scene.t))
    squared = [squared_distance(covariance, pose, true, part) for part in PARTS]
    turned = rotation_error(pose.rotation, scene.R)[1]
    return [*squared, turned, translation_direction_error_deg(pose.translation, scene.t)]


def main(*, out: Target | None = None, seeds: int = 200, jobs: int = 2) -> None:
    """Write the table of the shares of seeds whose regions hold the truth."""
    rows = []
    for name in CASES:
        of_seeds = mapped(partial(outcome, name=name), range(seeds), jobs)
        found = np.array([one for one in of_seeds if one is not None])
        rotation, translation = np.median(found[:, 3:], axis=0)
        shares = (f"{share:.2f}" for share in (found[:, :3] < BOUNDS).mean(axis=0))
        rows.append((name, len(found), *shares, f"{rotation:.0%}", f"{translation:.1f}"))
    words = f"Share of {seeds} seeds whose nominal 90 % region holds the truth, and median errors."
    publish(out, words, table(HEAD, rows))


if __name__ == "__main__":
    run(main)
