"""How often the 90 % regions of poses hold the truth, for independent and for correlated errors.

``python -m tools.evaluation.pose_coverage --out tools/results/pose_coverage.md``

Synthetic smears with known intrinsics (`synthetic_matches`), solved by ``estimate_two_view`` from smears
without order. "white": 1 px of noise on every coordinate, standard deviations stated truly, with and without
outliers. "correlated": directions and lengths err as one over 40 px, as those of a network; the standard
deviation of every displacement and the share of independent smears are stated truly.
"""

from functools import partial
from typing import NamedTuple, get_args

import numpy as np

from blur2view import RigidTransform, SmearMatches, estimate_two_view
from blur2view.smears.noise import NoiseModel
from tools.arguments import Target, run
from tools.datasets.synthetic_matches import (
    IMAGE_SIZE,
    Kind,
    SyntheticOptions,
    synthetic_smears,
    with_shared_errors,
)
from tools.evaluation.baselines import camera_of
from tools.metrics import CHI_SQUARED_90, rotation_error, squared_distance, translation_direction_error_deg
from tools.pages import publish, table
from tools.processes import mapped

CORRELATED_PX = 40.0  # standard deviation of the Gaussian over which errors of neighbours agree
PARTS = slice(0, 5), slice(0, 3), slice(3, 5)  # of the pose: all, rotation, translation
HEAD = "smears | poses | pose | rotation | translation | rotation error | translation error, degrees"


class Case(NamedTuple):
    """A kind of scene and of noise: outliers' share, or the direction's and the length's errors."""

    kind: Kind
    outliers: float = 0.0
    direction_deg: float = 0.0
    length_share: float = 0.0

    def __str__(self) -> str:
        if self.direction_deg:
            errors = f"{self.direction_deg:g} degrees, {100 * self.length_share:g} %"
            return f"correlated, {self.kind} depth, {errors}"
        return f"white, {self.kind} depth{f', {100 * self.outliers:g} % outliers' if self.outliers else ''}"


CASES = (
    *(Case(kind, share) for kind in get_args(Kind) for share in (0.0, 0.3)),
    Case("smooth", 0.0, 2.0, 0.05),
    *(Case(kind, 0.0, 4.0, 0.1) for kind in get_args(Kind)),
)


def correlated(ends: np.ndarray, seed: int, case: Case) -> SmearMatches:
    """Return exact smears (N, 2, 2) as a network sees them."""
    rng, errors = np.random.default_rng([seed, 1]), (case.direction_deg, case.length_share)
    ends = with_shared_errors(ends, rng, *errors, CORRELATED_PX)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    sigma_px = np.maximum(length * np.hypot(np.radians(errors[0]), errors[1]), 1e-2)
    patches = IMAGE_SIZE[0] * IMAGE_SIZE[1] / (4 * np.pi * CORRELATED_PX**2)
    shared = NoiseModel(effective_share=min(1.0, patches / len(ends)))
    return SmearMatches(ends=ends, sigma_px=sigma_px, image_size=IMAGE_SIZE, shared=shared)


def outcome(seed: int, case: Case) -> list[float] | None:
    """Return whether the regions of PARTS hold one seed's pose, and its errors; None without a pose."""
    noise_px = 0.0 if case.direction_deg else 1.0
    scene = synthetic_smears(
        seed, SyntheticOptions(kind=case.kind, outliers=case.outliers, noise_px=noise_px)
    )
    matches = correlated(scene.matches.ends, seed, case) if case.direction_deg else scene.matches
    geometry = estimate_two_view(matches, camera=camera_of(scene))
    pose, covariance = geometry.cam2_from_cam1, geometry.covariance
    if pose is None or covariance is None or not pose.translation.any():
        return None
    true = RigidTransform(rotation=scene.R, translation=scene.t / np.linalg.norm(scene.t))
    bounds = [CHI_SQUARED_90[part.stop - part.start] for part in PARTS]
    held = [squared_distance(covariance, pose, true, p) < b for p, b in zip(PARTS, bounds, strict=True)]
    turned = rotation_error(pose.rotation, scene.R)[1]
    return [*map(float, held), turned, translation_direction_error_deg(pose.translation, scene.t)]


def main(*, out: Target | None = None, seeds: int = 200, jobs: int = 2) -> None:
    """Write the table of the shares of seeds whose regions hold the truth."""
    rows = []
    for case in CASES:
        of_seeds = mapped(partial(outcome, case=case), range(seeds), jobs)
        found = np.array([one for one in of_seeds if one is not None]).reshape(-1, 5)
        rotation, translation = np.median(found[:, 3:], axis=0)
        shares = (f"{share:.2f}" for share in found[:, :3].mean(axis=0))
        rows.append((case, len(found), *shares, f"{rotation:.0%}", f"{translation:.1f}"))
    words = f"Share of {seeds} seeds whose nominal 90 % region holds the truth, and median errors."
    publish(out, words, table(HEAD, rows))


if __name__ == "__main__":
    run(main)
