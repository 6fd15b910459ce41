"""Formulas of two views against exact oracles and their invariances."""

import cv2
import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry import epipolar
from blur2view.geometry.epipolar import EndProducts
from blur2view.geometry.pose import rotation_flow, rotation_matrix


def random_matrices(seed: int, count: int) -> Array:
    return epipolar.unit_norm(np.random.default_rng(seed).normal(size=(count, 3, 3)))


def test_sampson_is_opencv_s() -> None:
    F, points = random_matrices(4, 1)[0], np.random.default_rng(4).normal(size=(10, 2, 2))
    x, y = epipolar.homogeneous(points[:, 0]), epipolar.homogeneous(points[:, 1])
    theirs = [cv2.sampsonDistance(a.reshape(3, 1), b.reshape(3, 1), F) for a, b in zip(x, y, strict=True)]
    assert np.allclose(epipolar.sampson(F, points[:, 0], points[:, 1]), theirs)


def test_serrmin_is_blind_to_order_and_transposition() -> None:
    F, ends = random_matrices(5, 3), np.random.default_rng(5).normal(size=(20, 2, 2))
    value = epipolar.serrmin(F, ends)
    assert value.shape == (3, 20)
    assert np.allclose(value, epipolar.serrmin(F, ends[:, ::-1]))
    assert np.allclose(value, epipolar.serrmin(np.swapaxes(F, 1, 2), ends))
    assert (value <= epipolar.sampson(F, ends[:, 0], ends[:, 1])).all()


@pytest.mark.parametrize(("models", "smears"), [(300, 100), (2, epipolar.CHUNK + 1)])
def test_costs_are_cut_sums_of_serrmin_however_many_there_are(models: int, smears: int) -> None:
    rng = np.random.default_rng(9)
    F, ends = random_matrices(9, models), rng.uniform(-0.5, 0.5, (smears, 2, 2))
    sigma = rng.uniform(0.001, 0.01, smears)
    batch, exact = EndProducts(ends, sigma, np.float32), epipolar.serrmin(F, ends) / sigma**2
    assert models * smears > epipolar.CHUNK
    for block in (slice(None), np.array([7, 3, 50])):
        summed = np.minimum(exact[:, block], 900.0).sum(axis=1)
        assert np.allclose(batch.costs(F, 900.0, block), summed, rtol=1e-3, atol=0.01)


def test_products_give_signed_sampson_distances_of_both_orders_and_their_derivatives() -> None:
    rng = np.random.default_rng(1)
    F, ends, tangents = rng.normal(size=(3, 3)), rng.normal(size=(20, 2, 2)), np.eye(9).reshape(9, 3, 3)
    products = EndProducts(ends)
    (ahead, behind), root = products.distances(F)
    assert np.allclose(ahead**2, epipolar.sampson(F, ends[:, 0], ends[:, 1]))
    assert np.allclose(behind**2, epipolar.sampson(F, ends[:, 1], ends[:, 0]))
    x, y = epipolar.homogeneous(ends[:, 0]), epipolar.homogeneous(ends[:, 1])
    assert (np.sign(ahead) == np.sign(np.einsum("ni,ij,nj->n", y, F, x))).all()
    analytic = products.derivatives(F, tangents, np.stack([ahead, behind]), root)
    for tangent, derivative in zip(tangents, analytic, strict=True):
        up, down = (products.distances(F + s * 1e-6 * tangent)[0] for s in (1, -1))
        assert np.allclose((up - down) / 2e-6, derivative, atol=1e-5)


def test_epipoles_are_the_null_vectors() -> None:
    F = epipolar.cross_matrix(np.array([[1.0, 2, 3]])) @ random_matrices(10, 3)  # of rank 2
    e1, e2 = epipolar.epipoles(F)
    assert np.abs(F @ e1[..., None]).max() < 1e-12
    assert np.abs(e2[:, None, :] @ F).max() < 1e-12
    assert np.allclose(np.abs(e2 @ [1, 2, 3]), np.sqrt(14))


def test_F_of_a_pose_vanishes_on_the_projections_of_points() -> None:
    rng, K = np.random.default_rng(12), np.array([[500.0, 0, 320], [0, 520, 240], [0, 0, 1]])
    R, t = rotation_matrix(np.array([0.1, -0.2, 0.3])), np.array([0.3, -0.1, 0.2])
    points = rng.uniform([-1, -1, 3], [1, 1, 5], (20, 3))
    x, y = (seen / seen[:, 2:] for seen in (points @ K.T, (points @ R.T + t) @ K.T))
    F = epipolar.fundamental_from_pose(K, R, t)
    assert np.isclose(np.linalg.norm(F), 1)
    assert np.abs(np.einsum("ni,ij,nj->n", y, F, x)).max() < 1e-12


def test_flow_of_a_rotation_is_the_motion_of_its_points() -> None:
    rng = np.random.default_rng(3)
    points, vector = rng.uniform(-0.5, 0.5, (20, 2)), 1e-6 * rng.normal(size=3)
    seen = np.column_stack([points, np.ones(20)])
    moved = seen + np.cross(vector, seen)
    exact = moved[:, :2] / moved[:, 2:] - points
    np.testing.assert_allclose(np.einsum("ikn,k->ni", rotation_flow(points), vector), exact, atol=1e-11)


@pytest.mark.parametrize("t_z", [0.5, -0.5])
def test_points_before_the_camera_move_along_the_lines(t_z: float) -> None:
    rng = np.random.default_rng(5)
    points, t = rng.uniform(-0.5, 0.5, (20, 2)), np.array([0.1, -0.05, t_z])
    moved = np.column_stack([points, np.ones(20)]) * rng.uniform(2, 5, (20, 1)) + t
    (along,), (across,) = epipolar.unit_lines(t[None], points)
    step = (moved[:, :2] / moved[:, 2:] - points).T
    np.testing.assert_allclose((across * step).sum(axis=0), 0, atol=1e-12)
    assert ((along * step).sum(axis=0) > 0).all()
    to_epipole = (t[:2] / t_z - points).T
    assert (np.sign((along * to_epipole).sum(axis=0)) == np.sign(t_z)).all()
