"""Rendered pictures against their own truth: F, both ends, and the blur itself."""

import functools

import numpy as np
import pytest

from blur2view.geometry.epipolar import sampson
from tests.tools.rendering.planes import SIZE, facing, wall
from tools.rendering.exposure import Exposure, grid_points
from tools.rendering.motion import Trajectory
from tools.rendering.render import Rendering, RenderOptions, expose, render

STRAIGHT_SEEDS = (2, 6, 4, 7, 11)


@functools.cache
def straight_scene(seed: int) -> Rendering:
    """Render a small scene with constant velocity and, where there are cards, moving objects."""
    return render(seed, RenderOptions(size=SIZE, straight=True, mover_share=1.0, smear_px=(4.0, 16.0)))


@pytest.mark.slow
def test_same_seed_gives_same_bytes_and_another_seed_does_not() -> None:
    options = RenderOptions(size=(96, 64))
    first, again, other = render(3, options), render(3, options), render(11, options)
    for name, value in vars(first).items():
        if isinstance(value, np.ndarray):
            assert value.tobytes() == getattr(again, name).tobytes(), name
    test = render(3, RenderOptions(size=(96, 64), split="test"))
    assert len({scene.linear.tobytes() for scene in (first, other, test)}) == 3
    assert not np.array_equal(first.K, test.K)  # another scene altogether, not only other textures


@pytest.mark.slow
def test_static_smears_of_straight_scenes_satisfy_their_own_fundamental() -> None:
    for seed in STRAIGHT_SEEDS:
        scene = straight_scene(seed)
        chosen = scene.valid & scene.static
        middle, half = grid_points(SIZE) + scene.middle_offset, scene.displacement.astype(float) / 2
        first, last = (middle - half)[chosen], (middle + half)[chosen]
        assert scene.F is not None
        exact = np.sqrt(sampson(scene.F, first, last).max())
        assert exact < 1e-3
        is_translation = np.array_equal(scene.R, np.eye(3))  # then F does not know the order of the ends
        assert is_translation or np.sqrt(np.median(sampson(scene.F, last, first))) > 10 * exact


def dot_scene(camera: Trajectory) -> Rendering:
    """Expose a dark wall at depth 1 with one bright Gaussian dot (sigma 2 px) at about pixel (80, 64)."""
    y, x = np.mgrid[:512, :512]
    texture = np.exp(-((x - 64) ** 2 + (y - 80) ** 2) / 8)[..., None].repeat(3, 2).astype(np.float32)
    exposure = Exposure(camera=camera, K=np.diag([200.0, 200, 1]), size=SIZE)
    layers = [wall(facing(1.0, texture, 200.0))]
    return expose(np.random.default_rng(0), layers, exposure, "translation", 2.0)


def moments(picture: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Sum, centroid (2,) and covariance (2, 2) of a picture's light."""
    light = picture[..., 0].astype(float)
    y, x = np.mgrid[: light.shape[0], : light.shape[1]]
    points, weights = np.stack([x.ravel(), y.ravel()]), light.ravel() / light.sum()
    centre = points @ weights
    return float(light.sum()), centre, ((points - centre[:, None]) * weights) @ (points - centre[:, None]).T


def test_dot_is_smeared_along_its_displacement_and_as_far() -> None:
    d = np.array([24.0, 10.0])
    scene = dot_scene(Trajectory(translation=np.array([-0.12, -0.05, 0])))
    np.testing.assert_allclose(scene.displacement, np.broadcast_to(d, scene.displacement.shape), atol=1e-4)
    sharp_sum, start, sharp = moments(scene.open_image)
    blurred_sum, middle, blurred = moments(scene.linear)
    assert blurred_sum == pytest.approx(sharp_sum, rel=1e-3)
    np.testing.assert_allclose(middle - start, d / 2, atol=0.02)
    np.testing.assert_allclose(moments(scene.close_image)[1] - start, d, atol=0.02)
    # a uniform line has the covariance d d^T / 12, added to the dot's own; interpolation softens a little
    np.testing.assert_allclose(blurred - sharp, np.outer(d, d) / 12, atol=0.3)
