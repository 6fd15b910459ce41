"""The rendered test split: photographs with exact truth and texture photographs that training never saw.

``python -m tools.datasets.testset render/test --scenes 60`` writes, per scene, ``NNNN.png`` (the blurred
photograph), ``NNNN.npz`` (truth on the stride-4 grid, K, R, t, F) and ``NNNN_open.png``, ``NNNN_close.png``
(the sharp first and last instants, for classical baselines). The same seeds give the same bytes.
"""

import multiprocessing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from blur2view import SmearMatches, read_image
from blur2view.arrays import AnyArray
from blur2view.smears.grid import Floats, smear_ends
from tools.arguments import Existing, run
from tools.processes import mapped
from tools.rendering.exposure import GRID, grid_points
from tools.rendering.render import Rendering, RenderOptions, render
from tools.rendering.sensor import SensorOptions, compress, photograph, tone
from tools.rendering.truth import SceneTruth

FIRST_SEED = 1_000_000
SERIES = 100_000  # distance of the seeds that are tried for one scene
ARRAYS = ("displacement", "valid", "static", "K", "R", "t")  # what is stored of a scene as it is


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
    return RenderOptions(size=size, smear_px=(4.0, 60.0), sharp_share=0.0, split="test", photos=photos)


def sharp_photograph(rng: np.random.Generator, linear: AnyArray, like: AnyArray) -> AnyArray:
    """Return an instant as a good camera would photograph it (uint8 RGB).

    Exposure follows the blurred picture `like`, tone curve and compression are fixed: both ends of one
    exposure come out alike, as two frames of one camera do. `rng` draws the noise.
    """
    signal = linear * np.float32(0.3 / max(float(like.mean()), 1e-3))
    noisy = signal + 0.003 * rng.standard_normal(signal.shape, dtype=np.float32)
    coded = tone(np.random.default_rng(2), np.clip(noisy, 0, 1).astype(np.float32))
    return compress(np.random.default_rng(1), (np.clip(coded, 0, 1) * 255 + 0.5).astype(np.uint8))


def scene_in_range(seed: int, options: RenderOptions, attempts: int = 20) -> tuple[Rendering, int]:
    """Return the rendering and number of the first seed whose median visible smear is in range.

    The renderer scales the median over all surfaces, hidden ones too, and bounds the longest smears, so that
    one scene in seven has a visible median outside.
    """
    for attempt in range(attempts):
        scene = render(seed + SERIES * attempt, options)
        if scene.valid.any() and options.smear_px[0] <= scene.median_px <= options.smear_px[1]:
            return scene, seed + SERIES * attempt
    raise RuntimeError(
        f"no seed of the series {seed} + {SERIES} k has a median smear in {options.smear_px} px"
    )


def write_scene(index: int, out: Path, options: RenderOptions) -> None:
    """Render, photograph and store one scene; finished ones are kept."""
    truth_path = out / f"{index:04d}.npz"
    if truth_path.exists():
        return
    scene, seed = scene_in_range(FIRST_SEED + index, options)
    rng = np.random.default_rng([seed, 2])
    write_photographed(truth_path, scene, rng)
    for suffix, instant in {"_open": scene.open_image, "_close": scene.close_image}.items():
        picture = sharp_photograph(rng, instant, scene.linear)
        cv2.imwrite(str(out / f"{index:04d}{suffix}.png"), picture[..., ::-1])


def write_photographed(path: Path, scene: Rendering, rng: np.random.Generator) -> None:
    """Write a photograph of a rendering, whose noise `rng` draws, and its truth."""
    truth = {name: getattr(scene, name) for name in (*ARRAYS, "kind", "F")}
    write_truth(path, photograph(rng, scene.linear, SensorOptions()), **truth)


def write_truth(path: Path, picture: AnyArray, **truth: Any) -> None:
    """Write what :func:`read_test_set` reads: the truth, and a picture (uint8 RGB) beside it as PNG."""
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
    photos: Existing | None = None,
    size: tuple[int, int] = (640, 480),
    jobs: int = multiprocessing.cpu_count(),
) -> None:
    """Write so many scenes, numbers from 0; a folder's photographs are further textures."""
    out.mkdir(parents=True, exist_ok=True)
    work = partial(write_scene, out=out, options=test_options(photos, size))
    list(mapped(work, range(scenes), jobs))


if __name__ == "__main__":
    run(main)
