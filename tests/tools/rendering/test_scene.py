"""Scenes: planes, layers and outlines, painted in place; and the paths that are moved along."""

import numpy as np

from tools.rendering.motion import Trajectory

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
