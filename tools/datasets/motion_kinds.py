"""Rendered photographs of four kinds of motion: the verdict on each is known.

    python -m tools.datasets.motion_kinds render/kinds --scenes 30

writes that many scenes of each kind as `testset` does, ``KIND/NNNNN.png`` and ``KIND/NNNNN.npz``, where NNNNN
is the seed, with the paths and textures of the test split. A camera that only turns, or holds still, sees any
scene; a plane fills the picture; of general motion those scenes are kept whose parallax is at least a fifth
of the smears (`off_plane`). Nothing moves by itself.
"""

import multiprocessing
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from blur2view.smears.grid import smear_ends
from tools.arguments import Existing, run
from tools.datasets.testset import SERIES, write_photographed
from tools.processes import mapped
from tools.rendering.exposure import Exposure, grid_points
from tools.rendering.motion import sample_camera_path
from tools.rendering.render import Rendering, expose, scaled_exposure
from tools.rendering.scene import (
    Layer,
    sample_illumination,
    sample_intrinsics,
    sample_layers,
    sample_plane,
    tilted_normal,
)
from tools.rendering.sensor import log_uniform
from tools.rendering.textures import Image, photographs

TRANSLATING = ("translation", "forward", "orbit", "mixed")
KINDS = {
    "rotation": ("rotation",),
    "plane": TRANSLATING,
    "still": ("rotation", *TRANSLATING),
    "general": TRANSLATING,
}
"""The kinds, and the paths that the camera may take."""
SMEARS_PX = (4.0, 60.0)  # median smears, log-uniform; those of a camera that holds still are below one pixel
LEAST_PARALLAX = 0.2
LEAST_SEEN = 0.05  # share of the image in which both ends of a smear are seen
TILT = 0.6  # largest tilt of a plane, radians


def off_plane(scene: Rendering) -> float:
    """Return how far true smears are from a homography of most of them, over their length; means."""
    rows, columns = scene.valid.shape
    points = grid_points((4 * columns, 4 * rows))[scene.valid]
    first, last = np.moveaxis(smear_ends(points, scene.displacement[scene.valid].astype(float)), 1, 0)
    H, _ = cv2.findHomography(first, last, cv2.LMEDS)
    if H is None:
        return 1.0
    missed = cv2.perspectiveTransform(first[None], H)[0] - last
    return float(np.linalg.norm(missed, axis=1).mean() / np.linalg.norm(last - first, axis=1).mean())


def one_plane(
    rng: np.random.Generator, pool: tuple[Image, ...], K: AnyArray, size: tuple[int, int]
) -> list[Layer]:
    """Return one random tilted plane that fills the image."""
    plane = sample_plane(rng, pool, K[0, 0], tilted_normal(rng, TILT), 1.0)
    return [Layer(planes=(plane,), relief=np.zeros((2, 2)), illumination=sample_illumination(rng))]


def attempt(kind: str, seed: int, photos: Path | None, size: tuple[int, int]) -> Rendering:
    """Return one rendered scene, whatever its parallax."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind), 16])
    pool, K = photographs("test", photos), sample_intrinsics(rng, size)
    layers = (one_plane if kind == "plane" else sample_layers)(rng, pool, K, size)
    path = ""
    while path not in KINDS[kind]:
        camera, path = sample_camera_path(rng)
    length_px = rng.random() ** 2 if kind == "still" else log_uniform(rng, SMEARS_PX)
    exposure = scaled_exposure(Exposure(camera=camera, K=K, size=size), layers, float(length_px))
    return expose(rng, layers, exposure, path, detail=1.5)


def motion_scene(kind: str, seed: int, photos: Path | None, size: tuple[int, int]) -> Rendering:
    """Return the first rendered scene of a kind of the seeds ``seed`` + SERIES k."""
    while True:
        scene = attempt(kind, seed, photos, size)
        wanted = scene.valid.mean() > LEAST_SEEN
        wanted = wanted and (kind == "still" or SMEARS_PX[0] <= scene.median_px <= SMEARS_PX[1])
        if wanted and (kind != "general" or off_plane(scene) >= LEAST_PARALLAX):
            return scene
        seed += SERIES


def write_scene(task: tuple[str, int], out: Path, photos: Path | None, size: tuple[int, int]) -> None:
    """Render, photograph and store the scene of a kind and a seed; finished ones are kept."""
    kind, seed = task
    path = out / kind / f"{seed:05d}.npz"
    if path.exists():
        return
    scene = motion_scene(kind, seed, photos, size)
    write_photographed(path, scene, np.random.default_rng([seed, 3]))


def main(
    out: Path,
    *,
    scenes: int = 30,
    photos: Existing | None = None,
    size: tuple[int, int] = (640, 480),
    jobs: int = multiprocessing.cpu_count(),
    seed: int = 20_000,
) -> None:
    """Write so many scenes of each kind, of seeds from ``seed`` on; photographs are further textures."""
    for kind in KINDS:
        (out / kind).mkdir(parents=True, exist_ok=True)
    tasks = [(kind, seed + i) for i in range(scenes) for kind in KINDS]
    list(mapped(partial(write_scene, out=out, photos=photos, size=size), tasks, jobs))


if __name__ == "__main__":
    run(main)
