"""Two-image models: which photographs count, how motions are compared, and one exposure through COLMAP."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from blur2view.camera.camera import Camera
from blur2view.colmap.database import write_database
from blur2view.colmap.mapping import mapper_options, triangulate_exposure
from blur2view.errors import DatabaseError
from blur2view.exposure.views import ExposureViews
from blur2view.geometry.pose import RigidTransform
from blur2view.geometry.rotation import rotation_matrix
from blur2view.geometry.two_view_geometry import Configuration, TwoViewGeometry
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.estimate import estimate_two_view
from tests.support.scenes import IMAGE_SIZE, disturb, make_scene
from tools.datasets.testset import TestScene
from tools.reconstruction.two_image_models import (
    ALONE,
    MotionError,
    Outcome,
    counts,
    keep_poses,
    markdown,
    reconstruct,
    smear_px,
    translation_share,
    with_default,
)
from tools.rendering.exposure import grid_points

SIZE = (160, 120)
K = np.array([[150.0, 0, 79.5], [0, 150, 59.5], [0, 0, 1]])


def scene_of(R: np.ndarray, t: np.ndarray, depth: float = 1.0) -> TestScene:
    """Exact smears of a wall at one depth: open at p - d/2, close at p + d/2."""
    points = grid_points(SIZE)
    rays = (points - K[:2, 2]) / 150
    d = np.zeros_like(points)
    for _ in range(20):  # the start from which the middle is p
        start = np.concatenate([rays - d / 2 / 150, np.ones_like(rays[..., :1])], axis=-1)
        moved = (start * depth) @ R.T + t
        d = (moved[..., :2] / moved[..., 2:] - start[..., :2]) * 150
    seen = np.ones(points.shape[:2], bool)
    return TestScene(
        name="0", image_path=Path("0.png"), displacement=d, valid=seen, static=seen, K=K, R=R, t=t, F=None,
        kind="mixed",
    )  # fmt: skip


def test_translation_share_is_what_the_rotation_leaves() -> None:
    turn = rotation_matrix(np.array([0.0, 0.1, 0.0]))
    assert translation_share(scene_of(turn, np.zeros(3))) < 1e-6
    assert translation_share(scene_of(np.eye(3), np.array([0.1, 0, 0]))) == pytest.approx(1)
    both = scene_of(turn, np.array([0.1, 0, 0]))  # both move the picture by 15 px to the right
    assert translation_share(both) == pytest.approx(0.5, abs=0.05)
    assert smear_px(both) == pytest.approx(30, rel=0.1)
    assert counts(both) and not counts(scene_of(turn, np.zeros(3)))
    assert not counts(scene_of(np.eye(3), np.array([0.05, 0, 0])))  # 7.5 px


def test_motion_error_takes_the_nearer_flip_of_time() -> None:
    true = RigidTransform(
        rotation=rotation_matrix(np.radians([0, 2.0, 0])), translation=np.array([1.0, 0, 0])
    )
    error = MotionError.of(true.inverse(), true)
    assert error.rotation_deg < 1e-6 and error.translation_deg < 1e-4
    off = RigidTransform(
        rotation=rotation_matrix(np.radians([0, 2.5, 0])),
        translation=np.array([np.cos(0.2), np.sin(0.2), 0]),
    )
    still = RigidTransform(rotation=np.eye(3), translation=np.array([1.0, 0, 0]))
    turned = RigidTransform(rotation=true.rotation, translation=np.array([-1.0, 0, 0]))
    error = MotionError.of(turned, still)  # without a rotation the translation decides
    assert error.translation_deg < 1e-4 and np.isnan(error.rotation) and not error.good
    error = MotionError.of(off, true)
    assert error.good
    assert error.rotation_deg == pytest.approx(0.5) and error.rotation == pytest.approx(0.25)
    assert error.translation_deg == pytest.approx(np.degrees(0.2))


@pytest.mark.parametrize("name", ALONE)
def test_one_option_goes_back_to_the_default(name: str) -> None:
    def values(options: object) -> dict[str, object]:
        found = {}
        for key in ALONE:
            value = options
            for part in key.split("."):
                value = getattr(value, part)
            found[key] = value
        return found

    ours, changed = values(mapper_options()), values(with_default(name))
    assert {key for key in ours if ours[key] != changed[key]} == {name}
    assert changed[name] == values(pycolmap.IncrementalPipelineOptions())[name]


def test_exposure_goes_through_colmap_and_into_the_tables() -> None:
    rng = np.random.default_rng(2)
    count = 400
    truth = disturb(make_scene(rng, count=count, length_px=25.0, rotation_share=0.4), rng, noise_px=0.5)
    camera = Camera(K=truth.K, width=IMAGE_SIZE[0], height=IMAGE_SIZE[1])
    matches = SmearMatches(ends=truth.ends, sigma_px=np.full(count, 1.0), image_size=IMAGE_SIZE)
    geometry = estimate_two_view(matches, camera=camera)
    index, swapped = np.arange(count), geometry.swapped.astype(int)
    views = ExposureViews(
        name="a.png",
        size=IMAGE_SIZE,
        points_open=truth.ends[index, swapped],
        points_close=truth.ends[index, 1 - swapped],
        sigma_px=matches.sigma_px,
        geometry=geometry,
        camera=camera,
    )
    model = reconstruct(views, mapper_options())
    assert model is not None and model.points > 0.8 * count and model.error_px < 1
    grid = np.zeros((2, 2, 2)) + [25.0, 0]
    scene = TestScene(
        name="a", image_path=Path("a.png"), displacement=grid, valid=np.ones((2, 2), bool),
        static=np.ones((2, 2), bool), K=truth.K, R=truth.R, t=truth.t, F=truth.F, kind="mixed",
    )  # fmt: skip
    kept = keep_poses(views)
    assert kept is not None and kept.points > 0.8 * count and kept.error_px < 1
    corrected = reconstruct(views.corrected(), mapper_options())
    outcome = Outcome(scene=scene, views=views, model=model, corrected=corrected, kept=kept)
    free, same = outcome.distance(model), outcome.distance(kept)
    assert free is not None and 1e-9 < free < 9.2
    near = outcome.distance(corrected)
    assert near is not None and near < 1e-2 * free
    assert same is not None and same < 1e-9
    error = MotionError.of(model.pose, outcome.true)
    assert error.rotation < 0.15 and error.translation_deg < 5
    missing = Outcome(scene=scene, views=views, model=None, corrected=None, kept=None)
    text = markdown([outcome, missing], {"min_model_size": 1}, "net")
    assert "`mapper_options()` | 1 of 2 | 1 of 1 |" in text and "`min_model_size` | 1" in text


def test_exposure_without_intrinsics_has_no_pose_to_keep(tmp_path: Path) -> None:
    none = np.zeros(3, bool)
    geometry = TwoViewGeometry(
        F=np.diag([1.0, -1, 0]), config=Configuration.UNCALIBRATED, reason="", inlier_mask=~none, swapped=none
    )
    views = ExposureViews(
        name="a.png", size=SIZE, points_open=np.zeros((3, 2)), points_close=np.ones((3, 2)),
        sigma_px=np.ones(3), geometry=geometry, camera=None,
    )  # fmt: skip
    assert keep_poses(views) is None
    write_database(tmp_path / "a.db", [views])
    turned = RigidTransform(rotation=np.eye(3), translation=np.zeros(3))
    still = replace(views, name="c.png", geometry=replace(geometry, cam2_from_cam1=turned))
    write_database(tmp_path / "c.db", [still])
    with pytest.raises(DatabaseError, match="not proven"):
        triangulate_exposure(tmp_path / "c.db", "c.png")
    for name, why in (("a.png", "--focal"), ("b.png", "no views of b.png")):
        with pytest.raises(DatabaseError, match=why):
            triangulate_exposure(tmp_path / "a.db", name)
    with pytest.raises(DatabaseError, match="no such database"):
        triangulate_exposure(tmp_path / "b.db", "a.png")
    assert not (tmp_path / "b.db").exists()
