"""Projection along paths against pinhole geometry, and its inverse on the grid."""

import numpy as np

from tools.rendering.exposure import Exposure, grid_points, pixel_grid, upsample
from tools.rendering.motion import Trajectory
from tools.rendering.scene import Layer, Plane

SIZE = (160, 128)
K = np.array([[150.0, 0, 80], [0, 150, 62], [0, 0, 1]])
STILL = (0.0, 0.0, 0.0)


def trajectory(rotation: tuple[float, ...] = STILL, translation: tuple[float, ...] = STILL) -> Trajectory:
    return Trajectory(rotation=np.array(rotation), translation=np.array(translation))


def wall(depth: float, own_path: Trajectory | None = None) -> Layer:
    texture = np.zeros((8, 8, 3), np.float32)
    normal = np.array([0.0, 0, 1])
    plane = Plane(normal=normal, offset=depth, texture=texture, texels_per_unit=9.0, turn=0.0)
    pivot = np.array([0.1, 0.2, depth])
    return Layer(planes=(plane,), relief=np.zeros((2, 2)), own_path=own_path, pivot=pivot)


def test_cells_have_their_centres_where_the_network_puts_them() -> None:
    points = grid_points(SIZE)
    assert points.shape == (32, 40, 2)
    np.testing.assert_array_equal(points[0, 0], [1.5, 1.5])
    np.testing.assert_array_equal(points[3, 2], [9.5, 13.5])
    np.testing.assert_array_equal(grid_points(SIZE, ring=1)[1:-1, 1:-1], points)


def test_object_turns_about_its_pivot_and_moves_with_its_path() -> None:
    still, turn = trajectory(), trajectory((0, 0, 1.0), (0.02, 0, 0))
    exposure, layer = Exposure(camera=still, K=K, size=SIZE), wall(2.0, own_path=turn)
    pivot = (K @ layer.pivot)[:2] / 2.0
    np.testing.assert_allclose(exposure.moved(pivot[None], layer, 0.5), [pivot + [0.01 * 150 / 2, 0]])
    beside = pivot + [10, 0]
    turned = exposure.moved(beside[None], layer, 0.5)[0] - exposure.moved(pivot[None], layer, 0.5)[0]
    np.testing.assert_allclose(turned, 10 * np.array([np.cos(0.5), np.sin(0.5)]))


def test_upsampling_keeps_a_linear_field_in_place() -> None:
    ring, pixels = grid_points(SIZE, ring=1), pixel_grid(SIZE)
    matrix = np.array([[0.2, -0.1], [0.3, 0.05]])
    np.testing.assert_allclose(upsample(ring @ matrix, SIZE), pixels @ matrix, atol=1e-3)
