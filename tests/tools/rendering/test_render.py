"""Rendered pictures and their truth against an independent computation with points and polygons in space."""

from typing import Any

import cv2
import numpy as np
import pytest

from blur2view.geometry.epipolar import sampson
from tools.rendering.render import Exposure, Rendering, expose, grid_points
from tools.rendering.scene import Layer, Plane, Trajectory

SIZE = (160, 128)
K = np.array([[160.0, 0, 79.5], [0, 160, 63.5], [0, 0, 1]])
CARD_BOX, CARD_DEPTH = (50.0, 40.0, 60.0, 44.0), 0.4


def facing(depth: float, texture: np.ndarray) -> Plane:
    """Return a plane across the optical axis; texel columns run down the image and rows to the right."""
    normal = np.array([0.0, 0, 1])
    return Plane(normal=normal, offset=depth, texture=texture, texels_per_unit=200.0, turn=0.0)


def path(rotation: Any = (0.0, 0, 0), translation: Any = (0.0, 0, 0)) -> Trajectory:
    """Return a path of constant velocity."""
    return Trajectory(rotation=np.array(rotation), translation=np.array(translation))


def card_before_wall(camera: Trajectory, own_path: Trajectory | None = None) -> Rendering:
    """Expose a grey card before a grey wall."""
    wall, card = (facing(depth, np.full((64, 64, 3), 0.5, np.float32)) for depth in (1.0, CARD_DEPTH))
    stencil = np.ones((160, 160), np.float32)
    layers = [Layer(planes=(wall,)), Layer(planes=(card,), stencil=stencil, box=CARD_BOX, own_path=own_path)]
    return expose(np.random.default_rng(0), layers, Exposure(camera=camera, K=K, size=SIZE), "")


def project(points: np.ndarray, camera: Trajectory, tau: float) -> np.ndarray:
    R, centre = camera.at(tau)
    image = (points - centre) @ R.T @ K.T
    return np.asarray(image[..., :2] / image[..., 2:])


def distance_inside(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Signed distance of points to a polygon's edge, positive inside."""
    corners = polygon.astype(np.float32)
    flat = [cv2.pointPolygonTest(corners, (float(x), float(y)), True) for x, y in points.reshape(-1, 2)]
    return np.array(flat).reshape(points.shape[:-1])


def in_space(points: np.ndarray, depth: np.ndarray | float) -> np.ndarray:
    """Return points (..., 3) seen at pixels (..., 2) at mid exposure."""
    rays = np.concatenate([points, np.ones((*points.shape[:-1], 1))], -1) @ np.linalg.inv(K).T
    return np.asarray(rays * depth)


def card_corners() -> np.ndarray:
    """Corners (4, 3) of the card in space."""
    x, y, width, height = CARD_BOX
    return in_space(np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]]), CARD_DEPTH)


@pytest.mark.parametrize(
    "camera",
    [path(translation=(0.1, 0.03, 0)), path((0.03, -0.04, 0.1), (-0.06, 0.04, 0.05))],
    ids=["sideways", "general"],
)
def test_smears_validity_pose_and_F_are_those_of_rays(camera: Trajectory) -> None:
    """Project the card's corners at either end, and ask which points they cover."""
    points, corners = grid_points(SIZE), card_corners()
    image = np.array([[0, 0], [159, 0], [159, 127], [0, 127]])
    at_middle = distance_inside(project(corners, camera, 0.0), points)
    on_card = at_middle > 0
    space = in_space(points, np.where(on_card, CARD_DEPTH, 1.0)[..., None])
    expected, doubtful, ends = np.ones(on_card.shape, bool), np.abs(at_middle) < 1.5, []
    for tau in (-0.5, 0.5):
        ends.append(project(space, camera, tau))
        covered, inside = (distance_inside(one, ends[-1]) for one in (project(corners, camera, tau), image))
        expected &= (on_card | (covered < 0)) & (inside > 0)
        doubtful |= (~on_card & (np.abs(covered) < 2.0)) | (np.abs(inside) < 0.01)
    found = card_before_wall(camera)
    np.testing.assert_array_equal(found.valid[~doubtful], expected[~doubtful])
    assert (~expected & ~doubtful).sum() > 30 and (expected & ~doubtful).sum() > 400
    np.testing.assert_allclose(found.displacement[~doubtful], (ends[1] - ends[0])[~doubtful], atol=1e-4)
    opened, closed = ((space - centre) @ R.T for R, centre in map(camera.at, (-0.5, 0.5)))
    np.testing.assert_allclose(opened @ found.R.T + found.t, closed, atol=1e-12)
    first, last = (end.reshape(-1, 2) for end in ends)
    assert found.F is not None and sampson(found.F, first, last).max() < 1e-12
    is_translation = np.array_equal(found.R, np.eye(3))  # then F does not know the order of the ends
    assert is_translation or np.median(sampson(found.F, last, first)) > 1e-3


def test_before_a_still_camera_the_moving_card_alone_is_not_static() -> None:
    calm, found = card_before_wall(path()), card_before_wall(path(), path(translation=(0.0, 0.02, 0)))
    assert calm.static.all() and not calm.displacement.any() and calm.valid.mean() > 0.99
    inside = distance_inside(project(card_corners(), path(), 0.0), grid_points(SIZE))
    np.testing.assert_array_equal(found.static[np.abs(inside) > 1.5], (inside < 0)[np.abs(inside) > 1.5])
    moved = found.displacement[~found.static & (inside > 1.5)]
    np.testing.assert_allclose(moved[:, 1], 0.02 * 160 / 0.4, rtol=1e-5)
    assert not found.displacement[found.static].any() and found.F is None


def moments(picture: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Sum, centroid (2,) and covariance (2, 2) of a picture's light."""
    light = picture[..., 0].astype(float)
    y, x = np.mgrid[: light.shape[0], : light.shape[1]]
    points, weights = np.stack([x.ravel(), y.ravel()]), light.ravel() / light.sum()
    centre = points @ weights
    return float(light.sum()), centre, ((points - centre[:, None]) * weights) @ (points - centre[:, None]).T


def test_a_dot_is_smeared_along_its_displacement_and_as_far() -> None:
    """A Gaussian dot of deviation 2 px at about pixel (80, 64) on a dark wall at depth 1."""
    d = np.array([24.0, 10.0])
    y, x = np.mgrid[:512, :512]
    texture = np.exp(-((x - 64) ** 2 + (y - 80) ** 2) / 8)[..., None].repeat(3, 2).astype(np.float32)
    exposure = Exposure(camera=path(translation=(-0.12, -0.05, 0)), K=np.diag([200.0, 200, 1]), size=SIZE)
    scene = expose(np.random.default_rng(0), [Layer(planes=(facing(1.0, texture),))], exposure, "translation")
    np.testing.assert_allclose(scene.displacement, np.broadcast_to(d, scene.displacement.shape), atol=1e-4)
    sharp_sum, start, sharp = moments(scene.open_image)
    blurred_sum, middle, blurred = moments(scene.linear)
    assert blurred_sum == pytest.approx(sharp_sum, rel=1e-3)
    np.testing.assert_allclose(middle - start, d / 2, atol=0.02)
    np.testing.assert_allclose(moments(scene.close_image)[1] - start, d, atol=0.02)
    # a uniform line has the covariance d d^T / 12, added to the dot's own; interpolation softens a little
    np.testing.assert_allclose(blurred - sharp, np.outer(d, d) / 12, atol=0.3)
