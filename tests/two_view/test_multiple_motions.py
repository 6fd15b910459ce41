"""Several motions: errors that neighbours share, two F for two halves, one F for one motion."""

from dataclasses import replace

import numpy as np
import pytest

from blur2view.geometry.epipolar import fundamental_from_pose
from blur2view.geometry.sampson import serrmin
from blur2view.geometry.two_view_geometry import Configuration
from blur2view.robust.field_fit import FieldFit
from blur2view.robust.homography_search import find_plane
from blur2view.robust.likelihood import Likelihood
from blur2view.two_view import multiple_motions
from blur2view.two_view.estimate import estimate_two_view
from blur2view.two_view.families import Fit, search_and_fit
from blur2view.two_view.multiple_motions import (
    BLOCKS,
    LEAST_BALANCE,
    LEAST_GAIN,
    TwoMotions,
    blocks_of,
    errors_by_order,
    explained,
    find_two_motions,
    independence,
    leaves_structure,
)
from blur2view.two_view.options import EstimatorOptions
from tools.datasets.degenerate_scenes import Kind, draw_scene
from tools.datasets.synthetic_matches import KnownMatches, SyntheticOptions, synthetic_smears


def fitted(scene: KnownMatches) -> tuple[Likelihood, Fit, FieldFit]:
    """Likelihood and best fit of a scene, and the best homography."""
    rng = np.random.default_rng(0)
    likelihood, fits, _ = search_and_fit(Likelihood.of(scene.matches), EstimatorOptions(), rng)
    plane = find_plane(likelihood, rng)
    assert plane is not None
    return likelihood, min(fits, key=lambda fit: fit.score), plane


def two(kind: Kind, seed: int) -> TwoMotions | None:
    likelihood, fit, plane = fitted(draw_scene(kind, seed))
    return find_two_motions(likelihood, fit.point.matrix(), plane, np.random.default_rng(0))


@pytest.mark.slow
def test_two_halves_that_move_differently_need_two_F() -> None:
    found = [two("several or none", seed) for seed in range(0, 20, 2)]
    several = [m for m in found if m is not None and m.balance >= LEAST_BALANCE]
    assert len(several) >= 7
    for motions in several:
        assert motions.gain >= LEAST_GAIN
        assert motions.second <= motions.first <= 1
        assert motions.first + motions.second > motions.single
        assert motions.balance <= 0.5


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["general", "pure translation"])
def test_one_motion_is_not_taken_for_two(kind: Kind) -> None:
    found = [two(kind, seed) for seed in range(12)]
    several = [motions for motions in found if motions is not None and motions.balance >= LEAST_BALANCE]
    assert len(several) <= 1


def test_errors_far_below_the_stated_are_not_suspicious() -> None:
    likelihood, fit, plane = fitted(draw_scene("several or none", 2))
    F, rng = fit.point.matrix(), np.random.default_rng(0)
    assert find_two_motions(likelihood, F, plane, rng) is not None
    assert find_two_motions(replace(likelihood, sigma_fitted=0.1), F, plane, rng) is None


def test_one_homography_that_explains_them_is_no_two_motions() -> None:
    likelihood, fit, plane = fitted(draw_scene("plane", 2))
    assert find_two_motions(likelihood, fit.point.matrix(), plane, np.random.default_rng(0)) is None


def test_where_no_F_is_found_there_are_no_two_motions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(multiple_motions, "_search", lambda likelihood, rng: None)
    assert two("several or none", 2) is None


def test_no_block_of_smears_fits_better_the_other_way_round() -> None:
    likelihood, fit, plane = fitted(draw_scene("general", 3))
    backward = plane.orders(likelihood).swapped
    forward, backwards = likelihood.residuals(fit.point.matrix()).both
    found = errors_by_order(likelihood, fit.point.matrix(), backward)
    other = np.where(found == forward, backwards, forward)
    block = blocks_of(likelihood.middle, BLOCKS)
    ours, others = (np.bincount(block, weights=np.minimum(e**2, 9.0)) for e in (found, other))
    assert len(ours) > 10 and (ours <= others).all()


def test_shares_follow_the_truth() -> None:
    scene = draw_scene("general", 3)
    likelihood, fit, _ = fitted(scene)
    shares, _ = explained(likelihood, [fit.point.matrix()])
    wrong = np.random.default_rng(0).normal(size=(3, 3))
    both, _ = explained(likelihood, [fit.point.matrix(), wrong])
    assert 0.65 < shares[0] <= 1  # 0 to 30 % outliers
    assert abs(both[0] - shares[0]) < 0.05 and both[1] < 0.1


def test_a_wrong_F_leaves_structure_and_the_true_one_does_not() -> None:
    for seed in range(4):
        scene = draw_scene("general", seed)
        likelihood, fit, plane = fitted(scene)
        backward = plane.orders(likelihood).swapped
        inverse = np.asarray(np.linalg.inv(likelihood.T), float)
        true = inverse.T @ fundamental_from_pose(scene.K, scene.R, scene.t) @ inverse
        delta = np.where(np.arange(len(fit.point.tangent())) < 2, 0.2, 0.0)
        turned = fit.point.step(delta).matrix()
        assert not leaves_structure(likelihood, true, backward)
        assert leaves_structure(likelihood, turned, backward)


def test_the_F_of_several_motions_is_that_of_the_larger_one() -> None:
    """Where 30 % of the smears move otherwise; F of the part found by place missed by 0.1 to 0.6."""
    options = SyntheticOptions(kind="smooth", outliers=0.0, second_motion=0.3)
    named = 0
    for seed in (10000, 10001, 10005):
        scene = synthetic_smears(seed, options)
        found = estimate_two_view(scene.matches)
        named += found.config is Configuration.MULTIPLE
        assert found.F is not None
        length = np.linalg.norm(scene.true_ends[:, 1] - scene.true_ends[:, 0], axis=1)
        assert np.median(np.sqrt(serrmin(found.F, scene.true_ends)) / length) < 0.03
    assert named >= 2


def test_independent_values_and_those_that_neighbours_share() -> None:
    rng = np.random.default_rng(0)
    middle = rng.uniform(0, 600, (2000, 2))
    values, used = rng.normal(size=(1, 2000)), np.ones(2000, bool)
    shared = np.sign(np.sin(middle[:, 0] / 60))[None] + 0.1 * values
    assert independence(values, used, middle) > 0.5
    assert independence(shared, used, middle) < 0.1
    assert independence(values, ~used, middle) == 1
