"""Painting layers: textures in place, averaged where fine, outlines and regions."""

import numpy as np
import pytest

from tests.tools.rendering.planes import SIZE, card, facing, wall
from tools.rendering import canvas
from tools.rendering.exposure import pixel_grid
from tools.rendering.scene import Layer

K = np.array([[200.0, 0, 0], [0, 200, 0], [0, 0, 1]])
BOX = (40, 30, 60, 50)


def dull(seed: int = 0) -> np.random.Generator:
    """Give a generator whose first draw adds no highlights."""
    rng = np.random.default_rng(seed)
    assert np.random.default_rng(seed).random() > 0.12
    return rng


def test_canvas_shows_the_texture_where_the_plane_is() -> None:
    texture = np.random.default_rng(0).random((512, 512, 3), np.float32)
    painted = canvas.paint(dull(), wall(facing(1.0, texture, 200.0)), K, SIZE, margin=8, detail=2.0)
    seen = painted.warp(pixel_grid(SIZE))
    rows, columns = np.mgrid[1 : SIZE[1], 1 : SIZE[0]]
    # axes of a plane facing the camera: texel x = image y, texel y = - image x, mirrored below zero
    np.testing.assert_allclose(seen[1:, 1:, :3], texture[columns - 1, rows], atol=1e-4)


def test_fine_texture_far_away_is_averaged_not_aliased() -> None:
    checks = np.indices((64, 64)).sum(0)[..., None] % 2 * np.ones(3, np.float32)
    layer = wall(facing(1.0, checks.astype(np.float32), 1600.0))
    painted = canvas.paint(dull(), layer, K, SIZE, margin=0, detail=1.0)
    assert np.abs(painted.rgba[4:-4, 4:-4, :3] - 0.5).max() < 0.02


def test_card_covers_its_box_alone() -> None:
    painted = canvas.paint(dull(), card(facing(), BOX), K, SIZE, margin=8, detail=1.5)
    alpha = painted.warp(pixel_grid(SIZE))[..., 3]
    np.testing.assert_allclose(alpha[32:78, 42:98], 1, atol=1e-3)
    assert np.count_nonzero(alpha) == np.count_nonzero(alpha[28:82, 38:102])
    np.testing.assert_allclose(painted.warp(pixel_grid(SIZE))[50, 60, :3], 0.5, atol=1e-3)


def test_nearest_plane_shows() -> None:
    both = Layer(planes=(facing(2.0, 0.1), facing(1.0, 0.9)), relief=np.zeros((2, 2)))
    rays = np.concatenate([np.random.default_rng(0).random((5, 6, 2)), np.ones((5, 6, 1))], -1)
    np.testing.assert_allclose(canvas.surface_colour(both, rays), 0.9, atol=1e-5)


def test_highlights_only_add_light_and_are_rare() -> None:
    rgb = np.full((40, 50, 3), 0.2, np.float32)
    lit = [canvas.add_highlights(np.random.default_rng(seed), rgb) for seed in range(100)]
    assert all((picture >= rgb).all() for picture in lit)
    bright = sum(picture.max() > 1 for picture in lit)
    assert 5 <= bright <= 25


@pytest.mark.parametrize("shift", [(0, 0), (30, -20), (-45, 10)])
def test_region_holds_every_pixel_a_card_reaches(shift: tuple[int, int]) -> None:
    painted = canvas.paint(dull(), card(facing(), BOX), K, SIZE, margin=8, detail=1.5)
    field = np.broadcast_to(-np.array(shift, float), (34, 42, 2))
    reached = painted.warp(pixel_grid(SIZE) - np.array(shift, np.float32))[..., 3] > 0
    region = painted.region(field, SIZE)
    assert region is not None
    assert reached[region].sum() == reached.sum() > 0
    assert reached[region].mean() > 0.7
    assert painted.region(np.full((34, 42, 2), -300.0), SIZE) is None  # beyond the image
