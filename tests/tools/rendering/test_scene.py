"""Scenes: planes, layers and outlines, painted in place; and the paths that are moved along."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tools.rendering.planes import SIZE, card, facing, wall
from tools.rendering import canvas, stencils
from tools.rendering.exposure import pixel_grid
from tools.rendering.motion import KINDS, Trajectory, sample_camera_path, sample_object_path
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
        depths = [each.pivot[2] for each in cards]
        assert depths == sorted(depths, reverse=True)
        for each in cards:
            assert each.stencil is not None
            assert not each.stencil[[0, -1]].any() and not each.stencil[:, [0, -1]].any()
            assert each.planes[0].normal @ each.pivot == pytest.approx(each.planes[0].offset)
            x, y, width, height = each.box
            centre = K @ each.pivot / each.pivot[2]
            np.testing.assert_allclose(centre[:2], [x + width / 2, y + height / 2])


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


BENT = Trajectory(
    rotation=np.array([0.1, -0.2, 0.3]),
    translation=np.array([0.4, 0.5, -0.6]),
    rotation_bend=np.array([0.2, 0.0, 0.1]),
    translation_bend=np.array([0.0, 0.3, 0.1]),
    acceleration=0.4,
)


def test_position_follows_velocity_acceleration_and_bend_from_the_identity_at_mid_exposure() -> None:
    R, position = BENT.at(0.0)
    np.testing.assert_array_equal(R, np.eye(3))
    np.testing.assert_array_equal(position, np.zeros(3))
    (_, first), (_, last) = BENT.at(-0.5), BENT.at(0.5)
    np.testing.assert_allclose(last - first, BENT.translation)
    np.testing.assert_allclose((last + first) / 2, (0.4 * BENT.translation + BENT.translation_bend) / 4)
    quarter = Trajectory(rotation=np.array([0, 0, np.pi]))
    np.testing.assert_allclose(quarter.at(0.5)[0] @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(quarter.at(-0.5)[0] @ [1, 0, 0], [0, -1, 0], atol=1e-12)


def test_scaled_path_goes_as_many_times_as_far() -> None:
    R, position = BENT.scaled(2.0).at(0.3)
    np.testing.assert_allclose(position, 2 * BENT.at(0.3)[1])
    once = BENT.at(0.3)[0]
    np.testing.assert_allclose(R, once @ once, atol=1e-12)  # same axis, twice the angle


def test_kinds_are_what_their_names_say() -> None:
    drawn = [sample_camera_path(np.random.default_rng(seed)) for seed in range(100)]
    assert {kind for _, kind in drawn} == set(KINDS)
    for path, kind in drawn:
        assert (kind == "rotation") == (not path.translation.any())
        assert kind != "translation" or not path.rotation.any()
        mover = sample_object_path(np.random.default_rng(0), path)
        speed = np.linalg.norm(path.translation) + 0.7 * np.linalg.norm(path.rotation)
        assert 0.4 <= np.linalg.norm(mover.translation) / speed <= 1.5  # comparable to the camera's
    along_axis = [path.translation[2] ** 2 for path, kind in drawn if kind == "forward"]
    assert np.median(along_axis) > 0.6


def test_tracking_shots_mostly_hold_unit_depth_still_and_the_others_move_it_further() -> None:
    """What a point at depth 1 on the axis does: rotation against translation, to first order."""
    held = []
    for seed in range(400):
        path, kind = sample_camera_path(np.random.default_rng(seed), straight=True)
        assert not (path.rotation_bend.any() or path.translation_bend.any() or path.acceleration)
        if kind != "orbit":
            continue
        R, centre = path.scaled(0.01).at(0.5)
        turned = R @ (np.array([0.0, 0, 1]) - centre)
        moved, unturned = np.linalg.norm(turned[:2] / turned[2]), np.linalg.norm(centre[:2])
        held.append(moved < unturned)
    assert len(held) > 30 and 0.6 < np.mean(held) < 0.95
