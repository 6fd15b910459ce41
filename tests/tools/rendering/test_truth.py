"""The truth against an independent computation with points and polygons in space."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from tests.tools.rendering.planes import SIZE, card, facing, path, wall
from tools.rendering import truth
from tools.rendering.canvas import paint
from tools.rendering.exposure import Exposure, grid_points
from tools.rendering.motion import Trajectory

K = np.array([[160.0, 0, 79.5], [0, 160, 63.5], [0, 0, 1]])
CARD_BOX = (50.0, 40.0, 60.0, 44.0)
CARD_DEPTH = 0.4


def compute(camera: Trajectory, own_path: Trajectory | None = None) -> SimpleNamespace:
    """Return the truth of a card before a wall."""
    layers = [wall(facing()), card(facing(CARD_DEPTH), CARD_BOX, own_path=own_path)]
    exposure = Exposure(camera=camera, K=K, size=SIZE)
    fields = [exposure.inverse_displacements(layer) for layer in layers]
    canvases = [paint(np.random.default_rng(0), layer, K, SIZE, 70, 1.5) for layer in layers]
    return SimpleNamespace(**truth.grid_truth(canvases, fields, exposure))


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
def test_validity_is_what_rays_say(camera: Trajectory) -> None:
    """Project the card's corners at either end, and ask which points they cover."""
    points, corners = grid_points(SIZE), card_corners()
    image = np.array([[0, 0], [159, 0], [159, 127], [0, 127]])
    at_middle = distance_inside(project(corners, camera, 0.0), points)
    on_card = at_middle > 0
    space = in_space(points, np.where(on_card, CARD_DEPTH, 1.0)[..., None])
    expected, doubtful = np.ones(on_card.shape, bool), np.abs(at_middle) < 1.5
    for tau in (-0.5, 0.5):
        end = project(space, camera, tau)
        covered, inside = (distance_inside(one, end) for one in (project(corners, camera, tau), image))
        expected &= (on_card | (covered < 0)) & (inside > 0)
        doubtful |= (~on_card & (np.abs(covered) < 2.0)) | (np.abs(inside) < 0.01)
    found = compute(camera)
    np.testing.assert_array_equal(found.valid[~doubtful], expected[~doubtful])
    assert (~expected & ~doubtful).sum() > 30 and (expected & ~doubtful).sum() > 400
    displacement = project(space, camera, 0.5) - project(space, camera, -0.5)
    np.testing.assert_allclose(found.displacement[~doubtful], displacement[~doubtful], atol=1e-4)


def test_before_a_still_camera_the_moving_card_alone_is_not_static() -> None:
    calm, found = compute(path()), compute(path(), path(translation=(0.0, 0.02, 0)))
    assert calm.static.all() and not calm.displacement.any() and calm.valid.mean() > 0.99
    inside = distance_inside(project(card_corners(), path(), 0.0), grid_points(SIZE))
    np.testing.assert_array_equal(found.static[np.abs(inside) > 1.5], (inside < 0)[np.abs(inside) > 1.5])
    moved = found.displacement[~found.static & (inside > 1.5)]
    np.testing.assert_allclose(moved[:, 1], 0.02 * 160 / 0.4, rtol=1e-5)
    assert not found.displacement[found.static].any()
