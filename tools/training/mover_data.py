"""Make the examples that the mover network learns from: pictures with known movers, read and measured.

``python -m tools.training.mover_data OUT --photos FOLDER --shards 100`` writes numbered shards of 16 pictures
of 640x480: things before photographs (`tools.rendering.things`) and, a share of them, rendered scenes. Every
picture goes through the camera, the smear network and the fit of its geometry, as a user's does. Shard k
depends on k, the photographs, the smear network and the font of the silhouettes only.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from blur2view import SmearNetwork, estimate
from blur2view.movers.camera_motion import Cells, camera_field
from blur2view.movers.inputs import Picture, of_cells, of_places
from blur2view.movers.probability import at_cells
from tools.arguments import Existing, run
from tools.datasets.shards import Example, write_shards
from tools.rendering.render import RenderOptions, render
from tools.rendering.shaken import ShakeOptions, processed
from tools.rendering.textures import load_photos
from tools.rendering.things import ThingOptions, Things, photographed_things

PICTURES = 16
"""In a shard."""
RENDERED_SHARE = 0.33
OPTIONS = ThingOptions()
CAMERA = ShakeOptions(size=OPTIONS.size, reduced_share=0.15)
READ_PX, READ_SHARE = 2.0, 0.25
"""Error of a smear that is still read right: constant, and of its length."""
CAMERA_SHARE = 0.5
"""Share of pictures whose camera's motion is fitted with the movers left out, as in a second round."""


def rendered(rng: np.random.Generator, photos: Path) -> Things:
    """Return a rendered scene, two thirds of them with movers, with textures of photographs of a folder."""
    options = RenderOptions(size=OPTIONS.size, mover_share=0.67, photos=photos)
    scene = render(int(rng.integers(2**31)), options)
    known = scene.valid & np.isfinite(scene.displacement).all(axis=-1)
    return Things(
        linear=scene.linear,
        moving=np.where(known, ~scene.static, -1).astype(np.float32),
        displacement=np.where(known[..., None], scene.displacement, 0).astype(np.float32),
        kind="rendered",
    )


def example_of(rng: np.random.Generator, things: Things, network: SmearNetwork) -> Example:
    """Return what a picture shows: ``places``, ``cells``, and the shares of places that move and are read."""
    image, _ = processed(rng, things.linear, CAMERA)
    image = np.asarray(np.clip(np.round(image), 0, 255) / 255, np.float32)
    found = estimate(image, network=network)
    cells, F = Cells.of(found.grid), found.geometry.F
    shape = found.grid.cells.shape[0], found.grid.cells.shape[1]
    weight = np.ones(shape)
    if rng.random() < CAMERA_SHARE:
        weight -= at_cells(np.clip(things.moving, 0, 1), shape)
    motion = np.zeros_like(cells.displacement)
    if found.blur.kind.of_camera:
        motion = camera_field(cells, weight, np.random.default_rng(0))
    picture = Picture(image, shape, found.grid.stride)
    side = found.grid.stride // 4
    seen = np.kron(cells.displacement, np.ones((side, side, 1)))
    error = np.minimum(*(np.linalg.norm(seen - sign * things.displacement, axis=-1) for sign in (1, -1)))
    read = error < READ_PX + READ_SHARE * np.linalg.norm(things.displacement, axis=-1)
    return {
        "places": of_places(picture, cells, motion).astype(np.float16),
        "cells": of_cells(cells, found.grid, motion, F).astype(np.float16),
        "moving": things.moving.astype(np.float16),
        "read": read,
        "kind": np.array(things.kind),
    }


def main(out: Path, *, photos: Existing, shards: int = 100, first: int = 0) -> None:
    """Write shards of sharp photographs in a folder."""
    sources, network = load_photos([photos]), SmearNetwork(threads=1)

    def examples(number: int) -> Iterator[Example]:
        rng = np.random.default_rng([43, number])
        for _ in range(PICTURES):
            of_scenes = rng.random() < RENDERED_SHARE
            things = rendered(rng, photos) if of_scenes else photographed_things(rng, sources, OPTIONS)
            yield example_of(rng, things, network)

    write_shards(out, range(first, first + shards), examples)


if __name__ == "__main__":
    run(main)
