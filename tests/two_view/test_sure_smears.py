"""Parallax by the smears that are sure of themselves: proven, or a rotation or a plane beside an open F."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.geometry.epipolar import cross_matrix
from blur2view.geometry.two_view_geometry import Configuration, MotionModel, Parallax
from blur2view.robust.homography import transfer_orders
from blur2view.robust.homography_search import find_plane
from blur2view.robust.parametrization import GeneralF
from blur2view.robust.problem import build_problem
from blur2view.robust.residuals import WeightedEnds
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.estimate import estimate_two_view
from blur2view.two_view.model_selection import Fit
from blur2view.two_view.sure_smears import LEAST, PROVEN_SHARE, SureSmears, judge_sure
from blur2view.two_view.verdict import Structure
from tests.support.scenes import IMAGE_SIZE, disturb, make_scene
from tools.datasets.degenerate_scenes import Kind, draw_scene, tilted_plane
from tools.datasets.synthetic_matches import camera, project_smears, scaled_motion


def erring(ends: Array, seed: int) -> Array:
    """Smears whose errors neighbours share, as those of a network that is sure of itself."""
    rng = np.random.default_rng([seed, 1])
    scene = replace(make_scene(rng, count=len(ends)), ends=ends)
    return disturb(scene, rng, direction_deg=1.5, length_share=0.03).ends


def judged(kind: Kind, seed: int, camera: Camera | None = None) -> SureSmears | None:
    scene = draw_scene(kind, seed)
    problem = build_problem(scene.true_ends, np.ones(len(scene.true_ends)), IMAGE_SIZE, camera)
    t = scene.t if scene.t.any() else np.array([1.0, 0.0, 0.0])
    to_camera = np.linalg.inv(scene.K) @ np.linalg.inv(problem.T)
    F = to_camera.T @ cross_matrix(t / np.linalg.norm(t)) @ scene.R @ to_camera
    fit = Fit(model=MotionModel.GENERAL, point=GeneralF.from_matrix(F), score=0.0)
    return judge_sure(erring(scene.true_ends, seed), problem, fit, 3.0, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("kind", "structure"),
    [
        ("pure rotation", Structure.ROTATION_OPEN),
        ("plane", Structure.PLANE_OPEN),
        ("general", Structure.PARALLAX),
    ],
)
def test_each_kind_is_named_despite_errors_that_neighbours_share(kind: Kind, structure: Structure) -> None:
    found = [judged(kind, seed) for seed in range(8)]
    assert sum(sure is not None and sure.structure is structure for sure in found) >= 7
    if structure is not Structure.PARALLAX:
        assert not any(sure is None or sure.proven for sure in found)


def test_a_known_camera_leaves_a_rotation_a_rotation() -> None:
    """A network's lengths err slowly over the picture, as another lens would have them."""
    for seed in range(3):
        scene = draw_scene("pure rotation", seed)
        x = scene.true_ends.mean(axis=1) - np.array(IMAGE_SIZE) / 2
        stretch = 1 + 0.12 * (x**2).sum(axis=1) / 320**2
        half = 0.5 * stretch[:, None] * (scene.true_ends[:, 1] - scene.true_ends[:, 0])
        middle = scene.true_ends.mean(axis=1)
        ends = np.stack([middle - half, middle + half], axis=1)
        camera = Camera(K=scene.K, width=IMAGE_SIZE[0], height=IMAGE_SIZE[1])
        matches = SmearMatches(ends=ends, sigma_px=0.3 * scene.matches.length_px, image_size=IMAGE_SIZE)
        geometry = estimate_two_view(replace(matches, sure_ends=erring(ends, seed)), camera=camera)
        assert geometry.config is Configuration.PANORAMIC and geometry.parallax is Parallax.OPEN


def test_few_sure_smears_judge_nothing() -> None:
    scene = draw_scene("general", 0)
    problem = build_problem(scene.true_ends, np.ones(len(scene.true_ends)), IMAGE_SIZE)
    fit = Fit(model=MotionModel.GENERAL, point=GeneralF.from_matrix(np.diag([1.0, 1.0, 0.0])), score=0.0)
    few = scene.true_ends[: LEAST - 1]
    assert judge_sure(few, problem, fit, 3.0, np.random.default_rng(0)) is None


def test_what_F_does_not_explain_is_no_parallax() -> None:
    one = SureSmears(plane=2 * PROVEN_SHARE, rotation=0.3, epipolar=0.5 * PROVEN_SHARE, A=np.zeros((3, 3)))
    assert one.proven
    assert not replace(one, epipolar=1.9 * PROVEN_SHARE).proven
    assert not replace(one, plane=0.9 * PROVEN_SHARE).proven
    assert replace(one, plane=0.01, rotation=None).structure is Structure.OPEN


@pytest.mark.parametrize(("relief", "known"), [(0.0, False), (0.13, False), (0.0, True), (0.06, True)])
def test_exact_smears_prove_the_little_parallax_of_a_relief(relief: float, known: bool) -> None:
    """Less than what a network's errors must be exceeded by; and a slope without relief has none."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        K, points = camera(rng), rng.uniform(0, 1, (1500, 2)) * np.array(IMAGE_SIZE)
        depth = tilted_plane(rng, points) * (1 + relief * (np.sin(points / 40).sum(axis=1) > 0))
        R, t = scaled_motion(K, points, depth, rng.normal(size=3), rng.normal(size=3), 0.5, 20.0)
        ends = project_smears(K, R, t, points, depth)
        matches = SmearMatches(ends=ends, sigma_px=np.full(len(ends), 0.5), image_size=IMAGE_SIZE)
        told = Camera(K=K, width=IMAGE_SIZE[0], height=IMAGE_SIZE[1]) if known else None
        geometry = estimate_two_view(replace(matches, sure_ends=ends), rng=rng, camera=told)
        assert (geometry.parallax is Parallax.PROVEN) == (relief > 0)


def test_a_lens_is_no_parallax() -> None:
    """Exact smears of a rotation and of a slope through a lens that is not told: F takes some of it up."""
    for seed, turns in product(range(4), (True, False)):
        rng = np.random.default_rng(seed)
        K, points = camera(rng), rng.uniform(0, 1, (1500, 2)) * np.array(IMAGE_SIZE)
        depth, share = tilted_plane(rng, points), np.inf if turns else 0.5
        R, t = scaled_motion(K, points, depth, rng.normal(size=3), rng.normal(size=3), share, 20.0)
        x = project_smears(K, R, t, points, depth) - np.array(IMAGE_SIZE) / 2
        ends = x * (1 - 0.25 * ((x / max(IMAGE_SIZE)) ** 2).sum(-1, keepdims=True)) + np.array(IMAGE_SIZE) / 2
        matches = SmearMatches(ends=ends, sigma_px=np.full(len(ends), 0.5), image_size=IMAGE_SIZE)
        assert estimate_two_view(replace(matches, sure_ends=ends), rng=rng).parallax is Parallax.OPEN


def test_the_sentence_names_both_limits() -> None:
    fit = Fit(model=MotionModel.GENERAL, point=GeneralF.from_matrix(np.diag([1.0, 1.0, 0.0])), score=0.0)
    kept = SureSmears(plane=0.078, rotation=None, epipolar=0.058, A=np.eye(3)).verdict(fit)
    assert "by 7.8% of their length (6.6% needed), F by 5.8% (at most 5.2%)" in kept.sentence
    exact = SureSmears(plane=0.03, rotation=None, epipolar=0.004, A=np.eye(3)).verdict(fit)
    assert exact.structure is Structure.OPEN and "(3.5% needed)" in exact.sentence
    assert "F by" not in exact.sentence  # what it may leave matters only where the homography does not do


def test_sure_smears_decide_where_the_surest_see_only_the_wall() -> None:
    """F from smears of the background, parallax from the cards before it, too."""
    alone, together = [], []
    for seed in range(4):
        scene = draw_scene("general", seed)
        ends = erring(scene.true_ends, seed)
        length = scene.matches.length_px
        wall = on_one_plane(scene.true_ends)
        matches = SmearMatches(ends=ends[wall], sigma_px=0.3 * length[wall], image_size=IMAGE_SIZE)
        alone.append(estimate_two_view(replace(matches, sure_ends=ends[wall])).parallax)
        together.append(estimate_two_view(replace(matches, sure_ends=ends)).parallax)
    assert Parallax.PROVEN not in alone and together.count(Parallax.PROVEN) >= 3


def on_one_plane(ends: Array) -> NDArray[np.int_]:
    """Return the 400 smears (indices) that the homography of most explains best."""
    matches = WeightedEnds(ends=ends / 768, sigma=np.full(len(ends), 1 / 768))
    plane = find_plane(matches, 3.0, False, np.random.default_rng(0))
    assert plane is not None
    best: NDArray[np.int_] = np.argsort(np.abs(transfer_orders(plane.generator(), matches).least))[:400]
    return best


def test_open_parallax_has_F_and_the_homography_that_is_named() -> None:
    scene = draw_scene("plane", 1)
    ends = erring(scene.true_ends, 1)
    matches = SmearMatches(ends=ends, sigma_px=0.3 * scene.matches.length_px, image_size=IMAGE_SIZE)
    geometry = estimate_two_view(replace(matches, sure_ends=ends))
    assert geometry.config is Configuration.PLANAR and geometry.parallax is Parallax.OPEN
    assert geometry.F is not None and geometry.H is not None
    assert geometry.reason.startswith("parallax is open")
