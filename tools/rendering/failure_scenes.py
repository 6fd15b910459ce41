"""Rendered photographs of what leaves F open: many movers, one dominant plane, a camera that only turns.

From the renderer's own parts and the textures of the test split; one integer seed decides each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from blur2view.arrays import AnyArray
from tools.rendering.exposure import Exposure
from tools.rendering.motion import Trajectory, sample_camera_path, sample_object_path
from tools.rendering.render import Rendering, expose, scaled_exposure
from tools.rendering.scene import (
    Layer,
    sample_background,
    sample_card,
    sample_illumination,
    sample_intrinsics,
    sample_plane,
    tilted_normal,
)
from tools.rendering.sensor import SensorOptions, photograph
from tools.rendering.textures import Image, photographs

CARDS, DRAWN = 6, 24
TILT = 0.6
"""Largest tilt of the plane, radians."""
LENGTHS_PX = (10.0, 30.0)
"""Median smears, log-uniform."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FailureScene:
    """A photograph (H, W, 3) uint8 and how it came about."""

    kind: str
    seed: int
    photograph: AnyArray
    rendering: Rendering


Layers = Callable[[np.random.Generator, "tuple[Image, ...]", AnyArray, "tuple[int, int]"], "list[Layer]"]


def cards(
    rng: np.random.Generator, pool: tuple[Image, ...], K: AnyArray, size: tuple[int, int]
) -> list[Layer]:
    """Return a background and before it, far to near, the CARDS of DRAWN that cover most of the image."""
    depths = np.sort(rng.uniform(0.3, 0.8, DRAWN))[::-1]
    drawn = [sample_card(rng, pool, K, size, float(z)) for z in depths]
    largest = sorted(np.argsort([-covered(card.box, size) for card in drawn])[:CARDS])
    return [sample_background(rng, pool, K[0, 0]), *(drawn[k] for k in largest)]


def covered(box: tuple[float, float, float, float], size: tuple[int, int]) -> float:
    """Return the area in square pixels of the part of a box that lies in the image."""
    start = np.maximum(box[:2], 0)
    sides = np.minimum(np.add(box[:2], box[2:]), size) - start
    return float(np.prod(np.maximum(sides, 0)))


def one_plane(
    rng: np.random.Generator, pool: tuple[Image, ...], K: AnyArray, size: tuple[int, int]
) -> list[Layer]:
    """Return one random tilted plane that fills the image."""
    plane = sample_plane(rng, pool, K[0, 0], tilted_normal(rng, TILT), 1.0)
    return [Layer(planes=(plane,), relief=np.zeros((2, 2)), illumination=sample_illumination(rng))]


def path_of(rng: np.random.Generator, kinds: tuple[str, ...]) -> tuple[Trajectory, str]:
    """Return a random straight camera path of one of these kinds."""
    while True:
        path, kind = sample_camera_path(rng, straight=True)
        if kind in kinds:
            return path, kind


TRANSLATING = ("translation", "orbit", "mixed")
KINDS: dict[str, tuple[Layers, tuple[str, ...]]] = {
    "many movers": (cards, TRANSLATING),
    "dominant plane": (one_plane, TRANSLATING),
    "pure rotation": (cards, ("rotation",)),
}
"""What is in the scene, and which paths the camera may take."""


def failure_scene(
    kind: str, seed: int, photos: Path | None = None, size: tuple[int, int] = (640, 480)
) -> FailureScene:
    """Return one rendered scene of a kind; the same arguments give the same bytes.

    Parameters
    ----------
    kind : str
        One of KINDS.
    seed : int
        Decides everything.
    photos : Path, optional
        Folder of photographs; its held-out part is used as textures.
    size : tuple of int
        Width and height in pixels, multiples of 4.
    """
    rng = np.random.default_rng([seed, list(KINDS).index(kind), 7])
    layers_of, paths = KINDS[kind]
    K = sample_intrinsics(rng, size)
    layers = layers_of(rng, photographs("test", photos), K, size)
    camera, path = path_of(rng, paths)
    length_px = float(np.exp(rng.uniform(*np.log(LENGTHS_PX))))
    exposure = scaled_exposure(Exposure(camera=camera, K=K, size=size), layers, length_px)
    if kind == "many movers":
        layers = [layers[0], *(moving(rng, card, exposure.camera) for card in layers[1:])]
    rendering = expose(rng, layers, exposure, path, detail=1.5)
    picture = photograph(rng, rendering.linear, SensorOptions(defocus_share=0.0))
    return FailureScene(kind=kind, seed=seed, photograph=picture, rendering=rendering)


def moving(rng: np.random.Generator, card: Layer, camera: Trajectory) -> Layer:
    """Return a card with a path of its own."""
    return replace(card, own_path=sample_object_path(rng, camera))
