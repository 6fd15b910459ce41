"""Views linked from true smears hold the motion that made them."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from blur2view.camera.colmap_camera import to_colmap
from blur2view.errors import Blur2ViewError
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.geometry.rotation import rotation_matrix
from tools.reconstruction.alignment import Motion, MotionErrors
from tools.reconstruction.sfm_experiment import estimated_motion
from tools.reconstruction.true_smears import link_true, true_field
from tools.rendering.exposure import grid_points

SIZE, FRAMES = (320, 240), 3
K = np.array([[300.0, 0, 159.5], [0, 300, 119.5], [0, 0, 1]])
TURN, MOVE = np.array([0.01, 0.02, -0.01]), np.array([0.05, -0.03, 0.02])


def smears() -> np.ndarray:
    """Exact close - open (h, w, 2) of a hilly surface at the grid's points."""
    rng = np.random.default_rng(0)
    points = grid_points(SIZE)
    hills = sum(np.sin(points @ rng.normal(0, 0.03, 2) + rng.uniform(0, 6)) for _ in range(6))
    depth = (1.2 + 0.12 * np.asarray(hills))[..., None]
    rays = (points - K[:2, 2]) / 300
    R = rotation_matrix(TURN)
    d = np.zeros_like(points)
    for _ in range(30):  # the start from which the middle is at the grid's point
        start = np.concatenate([rays - d / 600, np.ones_like(depth)], axis=-1)
        moved = (start * depth) @ R.T + MOVE
        d = (moved[..., :2] / moved[..., 2:] - start[..., :2]) * 300
    return d


@pytest.fixture
def database(tmp_path: Path) -> Path:
    """Return a project of photographs with features all over them, and matches between neighbours."""
    rng = np.random.default_rng(1)
    path = tmp_path / "project.db"
    keypoints = to_colmap(rng.uniform([8, 8], [311, 231], (600, 2))).astype(np.float32)
    params = [300, 300, 160, 120]
    with pycolmap.Database.open(path) as db:
        camera_id = db.write_camera(pycolmap.Camera(model="PINHOLE", width=320, height=240, params=params))
        ids = [db.write_image(pycolmap.Image(name=f"{k}.png", camera_id=camera_id)) for k in range(FRAMES)]
        for k, image_id in enumerate(ids):
            db.write_keypoints(image_id, keypoints + np.float32(20 * k))  # the picture moves down and right
        matches = np.arange(600, dtype=np.uint32)[:, None].repeat(2, axis=1)
        for k in range(FRAMES - 1):
            db.write_matches(ids[k], ids[k + 1], matches)
    return path


def test_motion_of_true_smears_is_found(database: Path) -> None:
    names = [f"{k}.png" for k in range(FRAMES)]
    displacement = np.stack([smears()] * FRAMES)
    facts = link_true(database, [database.parent / name for name in names], K, displacement)
    assert [fact["name"] for fact in facts] == names
    assert {fact["config"] for fact in facts} == {"CALIBRATED"}
    assert min(fact["num_matches"] for fact in facts) > 400
    with pycolmap.Database.open(database) as db:
        assert {image.name for image in db.read_all_images()} >= {
            n + end for n in names for end in (OPEN, CLOSE)
        }
    found = estimated_motion(database, names)
    length = np.linalg.norm(MOVE)
    true = Motion(rotations=np.tile(TURN, (FRAMES, 1)), translations=np.tile(MOVE / length, (FRAMES, 1)))
    flips = [MotionErrors.of(found, motion) for motion in (true, true.scaled(-1, -1))]
    turn = np.minimum(*(errors.rotation for errors in flips))
    assert turn.max() < 0.15
    assert np.minimum(*(errors.heading_deg for errors in flips)).max() < 8


def test_field_forgets_the_direction_of_time() -> None:
    d = smears()
    signs = {float(np.sign((true_field(d, np.random.default_rng(k)).displacement[2::4, 2::4] * d).sum()))
             for k in range(8)}  # fmt: skip
    assert signs == {-1.0, 1.0}
    assert true_field(d, np.random.default_rng(0)).shape == (SIZE[1], SIZE[0])


def test_photograph_that_is_not_in_the_database_is_refused(database: Path) -> None:
    with pytest.raises(Blur2ViewError, match="other"):
        link_true(database, [database.parent / "other.png"], K, smears()[None])
