"""What can be had from smears whose errors are correlated, and what ours makes of them, order unknown.

    python -m tools.datasets.testset render/test --scenes 60 --photos KODAK
    python -m tools.evaluation.correlated_noise render/test --out tools/results/correlated_noise

True smears of static valid cells are turned and stretched by noise correlated over 40 px, as a network errs.
The oracles know the order, start at the truth and believe errors proportional to the length; ours knows
neither order nor start. Columns are levels of the direction's noise; medians over scenes of the median rho.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.geometry.epipolar import apply_similarity, denormalise
from blur2view.metrics import rho, rotation_error, translation_direction_error_deg
from blur2view.robust.parametrization import CameraF, CameraPrior, GeneralF, Manifold, TranslationF
from blur2view.robust.refinement import refine
from blur2view.robust.residuals import OrderedResiduals, RefineOptions, WeightedEnds
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.estimate import estimate_two_view
from tools.arguments import parser_of, target
from tools.datasets.testset import TestScene, read_test_set
from tools.estimators.baselines import scrambled
from tools.evaluation.evaluate import true_ends
from tools.evaluation.processes import single_threaded_pool
from tools.rendering.exposure import GRID

DIRECTION_DEG = (1.0, 2.0, 4.0, 8.0)
LENGTH_SHARE = (0.15, 0.05)
CORRELATION_PX = 40.0
SMEARS = 2500
SCENES = 22
DRAWS = 3  # of the noise, per scene and level
BOUNDS = {"ours": "oracle, general F", "ours, K given": "oracle, E"}  # what each is held against
NO_PRIOR = (1e3, 1e3, 1e3)  # radians: as good as none


@dataclass(frozen=True, kw_only=True)
class Level:
    """Standard deviations of the noise: of the direction in degrees, of the natural log of the length."""

    direction_deg: float
    length_share: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Disturbed:
    """A scene's disturbed smears, in true order, and its true ends; pixels."""

    scene: TestScene
    ends: Array  # (N, 2, 2)
    true_ends: Array  # (M, 2, 2)
    level: Level

    @property
    def length_px(self) -> Array:
        """Lengths (N,) as disturbed."""
        return np.asarray(np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=1), float)


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How far one method's F is from the truth; ``rotation`` relative; NaN where it gives no pose."""

    method: str
    level: Level
    rho: float
    rotation: float = float("nan")
    translation_deg: float = float("nan")


@dataclass(frozen=True, kw_only=True, eq=False)
class OrderedEnds(WeightedEnds):
    """Smears in true order: the other order is given a residual too large to be chosen."""

    def residuals(self, F: Array, decided: bool = False, prior: Array | float = 0.5) -> OrderedResiduals:
        """Return residuals of the true order alone."""
        forward = super().residuals(F, decided).forward
        return OrderedResiduals(both=np.stack([forward, np.full_like(forward, 1e6)]), decided=True)


def smooth_noise(rng: np.random.Generator, points: Array, size: tuple[int, int]) -> Array:
    """Return unit-variance noise (N,) at pixels (N, 2), Gaussian-correlated over CORRELATION_PX."""
    width, height = size[0] // GRID, size[1] // GRID
    field = cv2.GaussianBlur(rng.normal(size=(height, width)), (0, 0), CORRELATION_PX / GRID)
    col, row = np.clip((points / GRID).astype(int), 0, [width - 1, height - 1]).T
    return np.asarray((field / field.std())[row, col], float)


def turns(scene: TestScene) -> bool:
    """Whether the camera turns during the exposure."""
    return not np.allclose(scene.R, np.eye(3), atol=1e-9)


def disturb(scene: TestScene, level: Level, rng: np.random.Generator) -> Disturbed:
    """Return at most SMEARS of the true smears, turned and stretched about their midpoints."""
    true = true_ends(scene)
    ends = true[rng.permutation(len(true))[:SMEARS]]
    rows, columns = scene.valid.shape
    size, middle = (columns * GRID, rows * GRID), ends.mean(axis=1)
    angle = np.radians(level.direction_deg) * smooth_noise(rng, middle, size)
    stretch = np.exp(level.length_share * smooth_noise(rng, middle, size))
    x, y = (ends[:, 1] - middle).T * stretch
    half = np.stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y], axis=1)
    moved = np.stack([middle - half, middle + half], axis=1)
    return Disturbed(scene=scene, ends=moved, true_ends=true, level=level)


def oracle(family: str, data: Disturbed) -> tuple[Array, Array | None, Array | None]:
    """Return F, R and t (if the family has them) fitted from the truth, in the true order."""
    scene = data.scene
    assert scene.F is not None
    T = np.linalg.inv(scene.K)
    focal = float(np.sqrt(scene.K[0, 0] * scene.K[1, 1]))
    # ends p -+ d/2 move oppositely, so an error of d moves the Sampson distance by 1 / sqrt(2) of it
    sigma = np.radians(data.level.direction_deg) / np.sqrt(2) * data.length_px / focal
    points = apply_similarity(T, data.ends.reshape(-1, 2)).reshape(-1, 2, 2)
    starts: dict[str, Manifold] = {
        "general F": GeneralF.from_matrix(scene.K.T @ scene.F @ scene.K),
        "two-parameter F": TranslationF(epipole=scene.t / np.linalg.norm(scene.t)),
        "E": CameraF(
            t=scene.t / np.linalg.norm(scene.t),
            R=scene.R,
            spread=CameraPrior(rotation=NO_PRIOR, log_focal=0.0, principal=0.0),
        ),
    }
    point = starts[family]
    for wide in (8, 1):  # the two-parameter F is far from the truth: first it needs to see all smears
        ordered = OrderedEnds(ends=points, sigma=wide * sigma)
        point, _ = refine(point, ordered, RefineOptions(max_iterations=100, decided=True))
    F = denormalise(point.matrix(), T)
    return (F, point.R, point.t) if isinstance(point, CameraF) else (F, None, None)


def ours(data: Disturbed, calibrated: bool = False) -> tuple[Array | None, Array | None, Array | None]:
    """Return F and, with K, R and t of the smears in random order, with truthful standard deviations."""
    rng = np.random.default_rng(0)
    relative = np.hypot(np.radians(data.level.direction_deg), data.level.length_share)
    rows, columns = data.scene.valid.shape
    size = columns * GRID, rows * GRID
    matches = SmearMatches(
        ends=scrambled(data.ends, rng), sigma_px=relative * data.length_px, image_size=size
    )
    camera = Camera(K=data.scene.K, width=size[0], height=size[1]) if calibrated else None
    found = estimate_two_view(matches, rng=rng, camera=camera)
    pose = found.cam2_from_cam1
    return (found.F, None, None) if pose is None else (found.F, pose.rotation, pose.translation)


METHODS: dict[str, Callable[[Disturbed], tuple[Array | None, Array | None, Array | None]]] = {
    "oracle, general F": partial(oracle, "general F"),
    "oracle, two-parameter F": partial(oracle, "two-parameter F"),
    "oracle, E": partial(oracle, "E"),
    "ours": ours,
    "ours, K given": partial(ours, calibrated=True),
    "true F": lambda data: (data.scene.F, None, None),
}


def judge(method: str, data: Disturbed) -> Outcome:
    """Return how good a method is; no F is the worst answer, an error as long as the smears."""
    F, R, t = METHODS[method](data)
    if F is None:
        return Outcome(method=method, level=data.level, rho=1.0)
    found = Outcome(method=method, level=data.level, rho=float(np.median(rho(F, data.true_ends))))
    if R is None or t is None:
        return found
    return replace(
        found,
        rotation=rotation_error(R, data.scene.R)[1],
        translation_deg=translation_direction_error_deg(t, data.scene.t),
    )


def study(scene: TestScene, methods: Iterable[str] = tuple(METHODS)) -> list[Outcome]:
    """Return every method on a scene at every level; the noise depends on scene, level and draw alone."""
    outcomes = []
    for share, degrees, draw in itertools.product(LENGTH_SHARE, DIRECTION_DEG, range(DRAWS)):
        level = Level(direction_deg=degrees, length_share=share)
        seed = int(scene.name), round(1000 * share), round(1000 * degrees), draw
        data = disturb(scene, level, np.random.default_rng(seed))
        outcomes += [judge(method, data) for method in methods]
    return outcomes


def table(outcomes: list[Outcome], length_share: float) -> list[str]:
    """Return rows of Markdown at one level of the length's noise."""
    levels = [Level(direction_deg=degrees, length_share=length_share) for degrees in DIRECTION_DEG]
    of = {
        name: [[o for o in outcomes if o.method == name and o.level == level] for level in levels]
        for name in dict.fromkeys(o.method for o in outcomes)
    }
    median_rho = {name: [float(np.median([o.rho for o in cell])) for cell in row] for name, row in of.items()}
    rows = [
        f"Median rho, length noise {length_share:.0%}:",
        "",
        "| direction noise, degrees | " + " | ".join(f"{degrees:g}" for degrees in DIRECTION_DEG) + " |",
        "|---|" + "---|" * len(DIRECTION_DEG),
        *(
            f"| {name} | " + " | ".join(f"{v:.4f}" for v in values) + " |"
            for name, values in median_rho.items()
        ),
    ]
    for name, best in BOUNDS.items():
        if name in of and best in of:
            ratios = np.divide(median_rho[name], median_rho[best])
            rows.append(f"| {name} over {best} | " + " | ".join(f"{r:.2f}" for r in ratios) + " |")
    for name, row in of.items():
        if any(np.isfinite(o.translation_deg) for cell in row for o in cell):
            rows.append(f"| {name}: rotation, translation | " + " | ".join(map(_pose, row)) + " |")
    return [*rows, ""]


def _pose(cell: list[Outcome]) -> str:
    """Return the medians of the pose's errors."""
    turn, move = (np.nanmedian([getattr(o, name) for o in cell]) for name in ("rotation", "translation_deg"))
    return f"{turn:.0%}, {move:.1f} deg"


def markdown(outcomes: list[Outcome], scenes: int) -> str:
    """Return both tables."""
    rows = [
        f"{scenes} rendered scenes whose camera translates and turns, {DRAWS} draws of noise correlated over "
        f"{CORRELATION_PX:g} px, {SMEARS} true smears each.",
        "",
    ]
    for share in LENGTH_SHARE:
        rows += table(outcomes, share)
    return "\n".join(rows)


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("scenes", type=Path, help="folder written by tools.datasets.testset")
    parser.add_argument("--count", type=int, default=SCENES, help="scenes, the first that do")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=target, help="write OUT.md")
    arguments = parser.parse_args()
    moving = [s for s in read_test_set(arguments.scenes) if s.F is not None and turns(s)]
    scenes = moving[: arguments.count]
    if not scenes:
        folder = arguments.scenes
        raise SystemExit(f"no scenes in {folder}: run python -m tools.datasets.testset {folder}")
    with single_threaded_pool(arguments.processes) as pool:
        outcomes = [o for part in pool.imap(study, scenes) for o in part]
    text = markdown(outcomes, len(scenes))
    print(text)
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.with_suffix(".md").write_text(text)


if __name__ == "__main__":
    main()
