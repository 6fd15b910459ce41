"""Rendered photographs with exact truth, of texture photographs that training never saw.

``python -m tools.datasets.testset render/test --scenes 60`` writes, per scene, ``NNNN.png`` (the blurred
photograph), ``NNNN.npz`` (truth on the stride-4 grid, K, R, t, F) and ``NNNN_open.png``, ``NNNN_close.png``,
the sharp first and last instants. With ``--kinds`` it writes that number of scenes of each of four kinds of
motion, ``KIND/NNNNN.png`` and so on, of seed NNNNN: a camera that only turns, or holds still, sees any scene;
a plane fills the picture; of general motion those scenes are kept whose parallax is at least a fifth of the
smears (`off_plane`). The same seeds give the same bytes; files that exist are kept.
"""

import multiprocessing
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from blur2view import SmearMatches, read_image
from blur2view.arrays import AnyArray, Floats
from blur2view.smears.grid import smear_ends
from tools.command import Existing, mapped, run
from tools.rendering.render import (
    GRID,
    Exposure,
    Rendering,
    RenderOptions,
    SceneTruth,
    expose,
    grid_points,
    render,
)
from tools.rendering.scene import (
    Layer,
    sample_camera_path,
    sample_illumination,
    sample_intrinsics,
    sample_layers,
    sample_plane,
    tilted_normal,
)
from tools.rendering.sensor import log_uniform, photograph, sharp_photograph
from tools.rendering.textures import photographs

FIRST_SEED = 1_000_000  # of the test split
SERIES = 100_000  # distance of the seeds that are tried for one scene
ARRAYS = ("displacement", "valid", "static", "K", "R", "t")  # of a scene, stored as they are
TRANSLATING = ("translation", "forward", "orbit", "mixed")
KINDS = {
    "rotation": ("rotation",),
    "plane": TRANSLATING,
    "still": ("rotation", *TRANSLATING),
    "general": TRANSLATING,
}
"""The kinds of motion, and the paths that the camera may take."""
MIN_PARALLAX = 0.2
MIN_SEEN = 0.05  # share of the image in which both ends of a smear are seen
TILT = 0.6  # largest tilt of a plane, radians


@dataclass(frozen=True, kw_only=True)
class TestScene(SceneTruth):
    """One photograph with its truth."""

    name: str
    image_path: Path

    __test__ = False  # pytest takes classes of this name for tests

    @property
    def image(self) -> Floats:
        """The photograph (H, W, 3), as `blur2view.read_image` gives it."""
        return read_image(self.image_path)

    @property
    def true_ends(self) -> AnyArray:
        """The ends (N, 2, 2), open then close, of the true smears of valid static cells."""
        return ends_of(self, self.valid & self.static)

    def truth_at(self, matches: SmearMatches) -> AnyArray:
        """Return the true displacements (N, 2) of the cells in which matches lie."""
        columns, rows = np.floor(matches.midpoint / GRID).astype(int).T
        return np.asarray(self.displacement[rows, columns])


def ends_of(scene: SceneTruth, chosen: AnyArray) -> AnyArray:
    """Return the ends (N, 2, 2), open then close, of the true smears of chosen cells."""
    rows, columns = chosen.shape
    middles = grid_points((columns * GRID, rows * GRID))
    return smear_ends(middles[chosen], scene.displacement[chosen].astype(np.float64))


def in_range(scene: Rendering, smear_px: tuple[float, float]) -> bool:
    """Whether the visible median is in a range: the renderer scales that of all surfaces, hidden ones too."""
    return bool(scene.valid.any()) and smear_px[0] <= scene.median_px <= smear_px[1]


def off_plane(scene: SceneTruth) -> float:
    """Return the mean distance of true smears from a homography of most of them, over their mean length."""
    first, last = np.moveaxis(ends_of(scene, scene.valid), 1, 0)
    H, _ = cv2.findHomography(first, last, cv2.LMEDS)
    if H is None:
        return 1.0
    missed = cv2.perspectiveTransform(first[None], H)[0] - last
    return float(np.linalg.norm(missed, axis=1).mean() / np.linalg.norm(last - first, axis=1).mean())


def of_kind(seed: int, kind: str, options: RenderOptions) -> Rendering:
    """Return a rendered scene of a kind, of any parallax."""
    rng, size = np.random.default_rng([seed, list(KINDS).index(kind), 16]), options.size
    pool, K = photographs(options.photos), sample_intrinsics(rng, size)
    if kind == "plane":
        plane = sample_plane(rng, pool, K[0, 0], tilted_normal(rng, TILT), 1.0)
        layers = [Layer(planes=(plane,), illumination=sample_illumination(rng))]
    else:
        layers = sample_layers(rng, pool, K, size)
    path = ""
    while path not in KINDS[kind]:
        camera, path = sample_camera_path(rng)
    length_px = float(rng.random() ** 2) if kind == "still" else log_uniform(rng, options.smear_px)
    return expose(rng, layers, Exposure(camera=camera, K=K, size=size).scaled(layers, length_px), path)


def is_wanted(scene: Rendering, kind: str, smear_px: tuple[float, float]) -> bool:
    """Whether a scene shows what its kind says, or, without one, smears as long as wanted."""
    seen = not kind or scene.valid.mean() > MIN_SEEN
    deep = kind != "general" or (seen and off_plane(scene) >= MIN_PARALLAX)
    return bool(seen and deep and (kind == "still" or in_range(scene, smear_px)))


def write_scene(task: tuple[str, int], out: Path, options: RenderOptions) -> None:
    """Render, photograph and store the scene of a kind and a seed, or of the split ("") and a number."""
    kind, number = task
    path = out / kind / (f"{number:05d}.npz" if kind else f"{number:04d}.npz")
    if path.exists():
        return
    draw, first = (partial(of_kind, kind=kind), number) if kind else (render, FIRST_SEED + number)
    scenes = ((seed, draw(seed, options=options)) for seed in count(first, SERIES))
    seed, scene = next(one for one in scenes if is_wanted(one[1], kind, options.smear_px))
    rng = np.random.default_rng([number, 3] if kind else [seed, 2])
    write_photographed(path, scene, rng)
    for end, instant in {"_open": scene.open_image, "_close": scene.close_image}.items():
        picture = sharp_photograph(rng, instant, scene.linear)
        cv2.imwrite(str(path.with_name(f"{path.stem}{end}.png")), picture[..., ::-1])


def write_photographed(path: Path, scene: Rendering, rng: np.random.Generator) -> None:
    """Write a photograph of a rendering, whose noise `rng` draws, and its truth."""
    truth = {name: getattr(scene, name) for name in (*ARRAYS, "kind", "F")}
    write_truth(path, photograph(rng, scene.linear), **truth)


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
            truth: dict[str, Any] = {key: stored[key] for key in ARRAYS} | {"kind": str(stored["kind"])}
            truth["F"] = stored["F"] if len(stored["F"]) else None
        scenes.append(TestScene(name=path.stem, image_path=path.with_suffix(".png"), **truth))
    if not scenes:
        raise SystemExit(f"no scenes in {folder}: run python -m tools.datasets.testset {folder}")
    return scenes


def main(
    out: Path,
    *,
    scenes: int = 60,
    kinds: bool = False,
    photos: Existing | None = None,
    jobs: int = multiprocessing.cpu_count(),
    seed: int = 20_000,
) -> None:
    """Write the scenes, or those of each kind of seeds from ``seed`` on; photographs are further textures."""
    of_kinds = [(kind, seed + k) for k in range(scenes) for kind in KINDS]
    tasks = of_kinds if kinds else [("", k) for k in range(scenes)]
    list(mapped(partial(write_scene, out=out, options=RenderOptions(photos=photos)), tasks, jobs))


if __name__ == "__main__":
    run(main)
