"""Planes, layers and outlines of random scenes."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tools.rendering.planes import SIZE, facing, wall
from tools.rendering import stencils
from tools.rendering.scene import Layer, sample_grid, sample_intrinsics, sample_layers
from tools.rendering.textures import photographs


def test_texture_lies_on_the_plane_without_distortion() -> None:
    normal = np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
    slanted = replace(facing(1.7, texels_per_unit=50.0), normal=normal, turn=0.3)
    rays = np.concatenate([np.random.default_rng(0).uniform(-1, 1, (50, 2)), np.ones((50, 1))], 1)
    points, texels = rays / slanted.inverse_depth(rays)[:, None], slanted.texel(rays)
    np.testing.assert_allclose(points @ slanted.normal, 1.7)
    distance = np.linalg.norm(points[1:] - points[:-1], axis=1)
    np.testing.assert_allclose(np.linalg.norm(texels[1:] - texels[:-1], axis=1), 50 * distance)


def test_nearest_plane_is_the_surface_and_relief_scales_it() -> None:
    near, far = facing(1.0), facing(2.0)
    rays, where = np.array([[0.1, 0.2, 1.0]]), np.array([[0.5, 0.5]])
    flat = Layer(planes=(far, near), relief=np.zeros((3, 3), np.float32))
    assert flat.inverse_depth(rays, where) == pytest.approx(1.0)
    relief = Layer(planes=(far, near), relief=np.full((3, 3), 0.5, np.float32))
    assert relief.inverse_depth(rays, where) == pytest.approx(np.exp(0.5))
    ground = wall(replace(facing(0.2), normal=np.array([0.0, 1, 0])))
    assert ground.inverse_depth(np.array([[0.0, -1.0, 1.0]]), where) > 0  # behind the plane, too


def test_grid_is_interpolated_between_its_nodes_and_mirrored_outside() -> None:
    grid = np.array([[1.0, 2.0, 4.0]] * 3, np.float32)
    where = np.array([[[0.0, 0.5], [0.25, 0.5], [1.0, 0.5], [-0.25, 0.5]]])
    np.testing.assert_allclose(sample_grid(grid, where)[0], [1, 1.5, 4, 1], atol=1e-6)
    np.testing.assert_allclose(sample_grid(grid, where[0]), [1, 1.5, 4, 1], atol=1e-6)
    assert not sample_grid(np.zeros((3, 3)), where).any()


@pytest.mark.parametrize("name", stencils.OUTLINES)
def test_outline_covers_a_part_of_its_box(name: str) -> None:
    outline = stencils.OUTLINES[name][0]
    alphas = np.stack([outline(np.random.default_rng(seed)) for seed in range(8)])
    assert alphas.shape[1:] == (stencils.SIZE, stencils.SIZE) and alphas.dtype == np.float32
    assert alphas.min() >= 0 and alphas.max() <= 1 + 1e-6
    assert 0.02 < alphas.mean() < 0.99
    np.testing.assert_array_equal(alphas[3], outline(np.random.default_rng(3)))


def test_layers_come_far_to_near_behind_their_pivots() -> None:
    pool = photographs("train")
    for seed in range(4):
        rng = np.random.default_rng(seed)
        K = sample_intrinsics(rng, SIZE)
        assert 0.6 * 160 <= K[0, 0] == K[1, 1] <= 1.6 * 160
        np.testing.assert_allclose(K[:2, 2], [79.5, 63.5], atol=6)
        background, *cards = sample_layers(rng, pool, K, SIZE)
        assert background.stencil is None
        depths = [card.pivot[2] for card in cards]
        assert depths == sorted(depths, reverse=True)
        for card in cards:
            assert card.stencil is not None
            assert not card.stencil[[0, -1]].any() and not card.stencil[:, [0, -1]].any()
            assert card.planes[0].normal @ card.pivot == pytest.approx(card.planes[0].offset)
            x, y, width, height = card.box
            centre = K @ card.pivot / card.pivot[2]
            np.testing.assert_allclose(centre[:2], [x + width / 2, y + height / 2])
