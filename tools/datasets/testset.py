"""Rendered photographs with exact truth, of texture photographs that training never saw.

``python -m tools.datasets.testset render/test --scenes 60`` writes, per scene, ``NNNN.png`` (the blurred
photograph), ``NNNN.npz`` (truth on the stride-4 grid, K, R, t, F) and ``NNNN_open.png``, ``NNNN_close.png``,
the sharp first and last instants. With ``--kinds`` it writes so many scenes of each of four kinds of motion,
``KIND/NNNNN.png`` and ``.npz`` of seed NNNNN: a camera that only turns, or holds still, sees any scene; a
plane fills the picture; of general motion those scenes are kept whose parallax is at least a fifth of the
smears (`off_plane`). The same seeds give the same bytes; what is there already is kept.
"""

import multiprocessing
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from blur2view import SmearMatches, read_image
from blur2view.arrays import AnyArray
from blur2view.smears.grid import Floats, smear_ends
from tools.arguments import Existing, run
from tools.processes import mapped
from tools.rendering.exposure import GRID, Exposure, grid_points
from tools.rendering.motion import sample_camera_path
from tools.rendering.render import Rendering, RenderOptions, expose, render, scaled_exposure
from tools.rendering.scene import (
    Layer,
    sample_illumination,
    sample_intrinsics,
    sample_layers,
    sample_plane,
    tilted_normal,
)
from tools.rendering.sensor import SensorOptions, compress, log_uniform, photograph, tone
from tools.rendering.textures import photographs
from tools.rendering.truth import SceneTruth

FIRST_SEED = 1_000_000  # of the test split
SERIES = 100_000  # distance of the seeds that are tried for one scene
ARRAYS = ("displacement", "valid", "static", "K", "R", "t")  # what is stored of a scene as it is
TRANSLATING = ("translation", "forward", "orbit", "mixed")
KINDS = {
    "rotation": ("rotation",),
    "plane": TRANSLATING,
    "still": ("rotation", *TRANSLATING),
    "general": TRANSLATING,
}
"""The kinds of motion, and the paths that the camera may take."""
SMEARS_PX = (4.0, 60.0)  # median smears, log-uniform; those of a camera that holds still are below one pixel
LEAST_PARALLAX = 0.2
LEAST_SEEN = 0.05  # share of the image in which both ends of a smear are seen
TILT = 0.6  # largest tilt of a plane, radians


@dataclass(frozen=True, kw_only=True)
class TestScene(SceneTruth):
    """One photograph with its truth."""

    name: str
    image_path: Path

    __test__ = False  # not a test class, whatever its name makes pytest think

    @property
    def image(self) -> Floats:
        """The photograph (H, W, 3), as `blur2view.read_image` gives it."""
        return read_image(self.image_path)

    @property
    def true_ends(self) -> AnyArray:
        """The ends (N, 2, 2), open then close, of the true smears of valid static cells."""
        chosen, (rows, columns) = self.valid & self.static, self.valid.shape
        middles = grid_points((columns * GRID, rows * GRID))
        return smear_ends(middles[chosen], self.displacement[chosen].astype(np.float64))

    def truth_at(self, matches: SmearMatches) -> AnyArray:
        """Return the true displacements (N, 2) of the cells in which matches lie."""
        columns, rows = np.floor(matches.midpoint / GRID).astype(int).T
        return np.asarray(self.displacement[rows, columns])


def test_options(photos: Path | None, size: tuple[int, int] = (640, 480)) -> RenderOptions:
    """Return the options of the split: median smears of 4 to 60 px, no sharp scenes."""
    return RenderOptions(size=size, smear_px=SMEARS_PX, sharp_share=0.0, split="test", photos=photos)


def sharp_photograph(rng: np.random.Generator, linear: AnyArray, like: AnyArray) -> AnyArray:
    """Return an instant (uint8 RGB) as a good camera shows it, exposed as the blurred picture `like`.

    `rng` draws the noise; tone curve and compression are fixed, so that both ends come out alike.
    """
    signal = linear * np.float32(0.3 / max(float(like.mean()), 1e-3))
    noisy = signal + 0.003 * rng.standard_normal(signal.shape, dtype=np.float32)
    coded = tone(np.random.default_rng(2), np.clip(noisy, 0, 1).astype(np.float32))
    return compress(np.random.default_rng(1), (np.clip(coded, 0, 1) * 255 + 0.5).astype(np.uint8))


def first_wanted(
    draw: Callable[[int], Rendering], seed: int, wanted: Callable[[Rendering], bool]
) -> tuple[Rendering, int]:
    """Return the first wanted rendering of the seeds ``seed`` + SERIES k, and its seed."""
    return next((scene, one) for one in count(seed, SERIES) if wanted(scene := draw(one)))


def in_range(scene: Rendering, smear_px: tuple[float, float]) -> bool:
    """Whether the visible median is in a range: the renderer scales that of all surfaces, hidden ones too."""
    return bool(scene.valid.any()) and smear_px[0] <= scene.median_px <= smear_px[1]


def write_scene(index: int, out: Path, options: RenderOptions) -> None:
    """Render, photograph and store one scene of the split."""
    if (path := out / f"{index:04d}.npz").exists():
        return
    wanted = partial(in_range, smear_px=options.smear_px)
    scene, seed = first_wanted(partial(render, options=options), FIRST_SEED + index, wanted)
    rng = np.random.default_rng([seed, 2])
    write_photographed(path, scene, rng)
    for suffix, instant in {"_open": scene.open_image, "_close": scene.close_image}.items():
        picture = sharp_photograph(rng, instant, scene.linear)
        cv2.imwrite(str(out / f"{index:04d}{suffix}.png"), picture[..., ::-1])


def off_plane(scene: Rendering) -> float:
    """Return how far true smears are from a homography of most of them, over their length; means."""
    rows, columns = scene.valid.shape
    points = grid_points((GRID * columns, GRID * rows))[scene.valid]
    first, last = np.moveaxis(smear_ends(points, scene.displacement[scene.valid].astype(float)), 1, 0)
    H, _ = cv2.findHomography(first, last, cv2.LMEDS)
    if H is None:
        return 1.0
    missed = cv2.perspectiveTransform(first[None], H)[0] - last
    return float(np.linalg.norm(missed, axis=1).mean() / np.linalg.norm(last - first, axis=1).mean())


def of_kind(seed: int, kind: str, photos: Path | None, size: tuple[int, int]) -> Rendering:
    """Return one rendered scene of a kind, whatever its parallax."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind), 16])
    pool, K = photographs("test", photos), sample_intrinsics(rng, size)
    if kind == "plane":
        plane = sample_plane(rng, pool, K[0, 0], tilted_normal(rng, TILT), 1.0)
        layers = [Layer(planes=(plane,), relief=np.zeros((2, 2)), illumination=sample_illumination(rng))]
    else:
        layers = sample_layers(rng, pool, K, size)
    path = ""
    while path not in KINDS[kind]:
        camera, path = sample_camera_path(rng)
    length_px = rng.random() ** 2 if kind == "still" else log_uniform(rng, SMEARS_PX)
    exposure = scaled_exposure(Exposure(camera=camera, K=K, size=size), layers, float(length_px))
    return expose(rng, layers, exposure, path, detail=1.5)


def is_clear(scene: Rendering, kind: str) -> bool:
    """Whether a scene shows what its kind says."""
    seen = scene.valid.mean() > LEAST_SEEN and (kind == "still" or in_range(scene, SMEARS_PX))
    return bool(seen and (kind != "general" or off_plane(scene) >= LEAST_PARALLAX))


def motion_scene(kind: str, seed: int, photos: Path | None, size: tuple[int, int]) -> Rendering:
    """Return the scene of a kind and a seed."""
    draw = partial(of_kind, kind=kind, photos=photos, size=size)
    return first_wanted(draw, seed, partial(is_clear, kind=kind))[0]


def write_motion(task: tuple[str, int], out: Path, photos: Path | None, size: tuple[int, int]) -> None:
    """Render, photograph and store the scene of a kind and a seed."""
    kind, seed = task
    if not (path := out / kind / f"{seed:05d}.npz").exists():
        write_photographed(path, motion_scene(kind, seed, photos, size), np.random.default_rng([seed, 3]))


def write_photographed(path: Path, scene: Rendering, rng: np.random.Generator) -> None:
    """Write a photograph of a rendering, whose noise `rng` draws, and its truth."""
    truth = {name: getattr(scene, name) for name in (*ARRAYS, "kind", "F")}
    write_truth(path, photograph(rng, scene.linear, SensorOptions()), **truth)


def write_truth(path: Path, picture: AnyArray, **truth: Any) -> None:
    """Write what `read_test_set` reads: the truth, and a picture (uint8 RGB) beside it as PNG."""
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path.with_suffix(".png")), picture[..., ::-1])
    stored: dict[str, Any] = {k: np.zeros((0, 3)) if value is None else value for k, value in truth.items()}
    np.savez(path, **stored)


def read_test_set(folder: Path) -> list[TestScene]:
    """Return the scenes of a folder in order of their names; SystemExit if it holds none."""
    scenes = []
    for path in sorted(folder.glob("[0-9]*.npz")):
        with np.load(path) as stored:
            arrays = {key: stored[key] for key in ARRAYS}
            F = stored["F"] if stored["F"].shape == (3, 3) else None
            image_path, kind = path.with_suffix(".png"), str(stored["kind"])
            scenes.append(TestScene(name=path.stem, image_path=image_path, F=F, kind=kind, **arrays))
    if not scenes:
        raise SystemExit(f"no scenes in {folder}: run python -m tools.datasets.testset {folder}")
    return scenes


def main(
    out: Path,
    *,
    scenes: int = 60,
    kinds: bool = False,
    photos: Existing | None = None,
    size: tuple[int, int] = (640, 480),
    jobs: int = multiprocessing.cpu_count(),
    seed: int = 20_000,
) -> None:
    """Write so many scenes, or of each kind of seeds from ``seed`` on; photographs are further textures."""
    if kinds:
        tasks = [(kind, seed + i) for i in range(scenes) for kind in KINDS]
        list(mapped(partial(write_motion, out=out, photos=photos, size=size), tasks, jobs))
    else:
        list(mapped(partial(write_scene, out=out, options=test_options(photos, size)), range(scenes), jobs))


if __name__ == "__main__":
    run(main)
