"""F from a dominant plane and the parallax beside it: exact, and over named seeds against plain samples."""

from dataclasses import replace

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.epipolar import fundamental_from_pose, unit_norm
from blur2view.geometry.sampson import sampson, serrmin
from blur2view.geometry.two_view_geometry import Configuration
from blur2view.robust.homography import cayley
from blur2view.robust.homography_search import find_plane
from blur2view.robust.likelihood import Likelihood
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.estimate import estimate_two_view
from blur2view.two_view.plane_parallax import fundamentals_through, parallax_lines, plane_and_parallax
from tools.datasets.degenerate_scenes import tilted_plane
from tools.datasets.synthetic_matches import IMAGE_SIZE, camera, project_smears, random_smears, scaled_motion
from tools.estimators.seven_smears import solve_seven_smears
from tools.metrics import epipole_angle_deg


def dominant_plane(
    seed: int, noise_px: float, outliers: float, count: int = 800
) -> tuple[SmearMatches, Array, Array]:
    """Smears of which 80 % lie on one plane, K and F."""
    rng = np.random.default_rng(seed)
    K, points = camera(rng), rng.uniform(0, 1, (count, 2)) * np.array(IMAGE_SIZE)
    depth = tilted_plane(rng, points)
    depth = np.where(rng.random(count) < 0.2, depth * np.exp(rng.uniform(-0.5, 0.5, count)), depth)
    R, t = scaled_motion(K, points, depth, rng.normal(size=3), rng.normal(size=3), 0.5, 25.0)
    ends = project_smears(K, R, t, points, depth)
    wrong = rng.random(count) < outliers
    ends[wrong] = random_smears(rng, ends)[wrong]
    ends += noise_px * rng.normal(size=ends.shape)
    ends[::2] = ends[::2, ::-1]
    matches = SmearMatches(ends=ends, sigma_px=np.full(count, 2 * noise_px + 0.02), image_size=IMAGE_SIZE)
    return matches, K, fundamental_from_pose(K, R, t)


def test_lines_of_parallax_pass_the_epipole_in_one_of_the_orders() -> None:
    rng = np.random.default_rng(0)
    A, epipole = 0.02 * rng.normal(size=(3, 3)), np.array([0.3, -0.2, 1.0])
    F = fundamentals_through(A, epipole[None])[0]
    x, z = rng.uniform(-0.4, 0.4, (2, 20, 2))
    line = np.c_[x, np.ones(20)] @ F.T
    y = z - ((np.c_[z, np.ones(20)] * line).sum(1) / (line[:, :2] ** 2).sum(1))[:, None] * line[:, :2]
    ends = np.stack([x, y], axis=1)
    assert sampson(F, x, y).max() < 1e-25
    lines = parallax_lines(A, ends)
    unit = lines / np.linalg.norm(lines, axis=-1, keepdims=True)
    assert np.abs(unit[:, 0] @ epipole).max() < 1e-12
    assert np.median(np.abs(unit[:, 1] @ epipole)) > 1e-3
    assert np.allclose(parallax_lines(A, ends[:, ::-1]), lines[:, ::-1])


def test_F_is_compatible_with_the_homography() -> None:
    rng = np.random.default_rng(1)
    A = 0.05 * rng.normal(size=(3, 3))
    F = fundamentals_through(A, rng.normal(size=(4, 3)))
    product = np.swapaxes(F, 1, 2) @ cayley(A)
    assert np.allclose(product, -np.swapaxes(product, 1, 2), atol=1e-12)  # F^T H is skew
    assert np.abs(np.linalg.det(F)).max() < 1e-12


def test_exact_smears_give_the_exact_F() -> None:
    rng = np.random.default_rng(2)
    A = 0.02 * rng.normal(size=(3, 3))
    F = unit_norm(fundamentals_through(A, np.array([[0.5, 0.4, 1.0]]))[0])
    x = rng.uniform(-0.4, 0.4, (100, 2))
    along = np.c_[x, np.ones(100)] @ F.T
    y = np.c_[x, np.ones(100)] @ cayley(A).T
    y = y[:, :2] / y[:, 2:]
    y[:30] += rng.normal(0, 0.02, (30, 1)) * np.stack([along[:30, 1], -along[:30, 0]], axis=1)
    ends = np.stack([x, y], axis=1)
    ends[::2] = ends[::2, ::-1]
    likelihood = Likelihood.of(SmearMatches(ends=768 * ends, sigma_px=np.full(100, 0.1)))
    T = likelihood.T @ np.diag([768.0, 768.0, 1.0])  # from these coordinates to the likelihood's
    moved = T @ cayley(A) @ np.linalg.inv(T)
    B = 2 * (moved - np.eye(3)) @ np.linalg.inv(moved + np.eye(3))
    found = plane_and_parallax(B, likelihood, np.arange(30), np.random.default_rng(0))
    assert found is not None
    back = unit_norm(T.T @ found @ T)
    assert min(np.abs(back - s * f).max() for s in (1, -1) for f in (F, F.T)) < 1e-9


def test_one_smear_off_the_plane_is_not_enough() -> None:
    ends = np.random.default_rng(0).uniform(0, 400, (20, 2, 2))
    likelihood = Likelihood.of(SmearMatches(ends=ends, sigma_px=np.ones(20), image_size=(400, 400)))
    assert plane_and_parallax(np.zeros((3, 3)), likelihood, np.arange(1), np.random.default_rng(0)) is None


def seven_smear_ransac(matches: SmearMatches, samples: int, rng: np.random.Generator) -> Array:
    """Best F of plain samples of seven: what a plane that dominates spoils."""
    drawn = np.stack([rng.permutation(len(matches))[:7] for _ in range(samples)])
    models = solve_seven_smears(matches.ends[drawn])
    cost = [np.minimum(serrmin(F, matches.ends), 1.0).sum() for F in models]
    best: Array = models[int(np.argmin(cost))]
    return best


@pytest.mark.slow
def test_F_beside_a_dominant_plane_is_recovered_where_plain_samples_fail() -> None:
    """80 % of the smears on a plane, 20 % off it, one in ten wrong: epipole's error over 16 seeds.

    Pairs of smears off the plane against 60 plain samples of seven smears, neither refined, and the whole.
    """
    plain: list[float] = []
    through_plane: list[float] = []
    ours: list[float] = []
    for seed in range(16):
        matches, K, F = dominant_plane(seed, 0.3, 0.1)
        rng = np.random.default_rng(0)
        likelihood = Likelihood.of(replace(matches, sigma_px=np.full(len(matches), 0.8)))
        plane = find_plane(likelihood, rng)
        assert plane is not None
        off_plane = np.flatnonzero(plane.orders(likelihood).least ** 2 > 9)
        assert 0.1 < len(off_plane) / len(matches) < 0.35
        found = plane_and_parallax(plane.family.generator(), likelihood, off_plane, rng)
        geometry = estimate_two_view(matches)
        assert geometry.config is Configuration.UNCALIBRATED
        assert found is not None and geometry.F is not None
        models = seven_smear_ransac(matches, 60, rng), likelihood.pixels(found), geometry.F
        for errors, model in zip((plain, through_plane, ours), models, strict=True):
            errors.append(epipole_angle_deg(model, F, K))
    assert np.median(through_plane) < 4
    assert np.median(plain) > 3 * np.median(through_plane)
    assert sorted(ours)[-2] < 5
