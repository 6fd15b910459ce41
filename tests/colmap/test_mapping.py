"""COLMAP's mappers on exposures: nothing with their defaults, the camera's motion with our options."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest

from blur2view.colmap.database import write_database
from blur2view.colmap.mapping import mapper_options
from blur2view.geometry.pose import RigidTransform
from tests.support.colmap_projects import some_views
from tests.support.scenes import IMAGE_SIZE, Scene, disturb, make_scene
from tools.metrics import rotation_error, translation_direction_error_deg

COUNT = 500


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Return an exposure of 20 px smears with half a pixel of noise."""
    rng = np.random.default_rng(4)
    return disturb(make_scene(rng, count=COUNT, length_px=20.0, rotation_share=0.5), rng, noise_px=0.5)


@pytest.fixture(scope="module")
def database(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a database of both views."""
    (first, last), t = scene.ordered, scene.t / np.linalg.norm(scene.t)
    pose = RigidTransform(rotation=scene.R, translation=t)
    plain = some_views("a", COUNT)
    geometry = replace(plain.geometry, F=scene.F, cam2_from_cam1=pose, inlier_mask=np.ones(COUNT, bool))
    path = tmp_path_factory.mktemp("mapping") / "exposure.db"
    views = replace(plain, size=IMAGE_SIZE, points_open=first, points_close=last, camera=scene.camera)
    write_database(path, [replace(views, geometry=geometry)])
    return path


def models(database: Path, options: Any, out: Path) -> dict[int, Any]:
    options.num_threads = 1
    found: dict[int, Any] = pycolmap.incremental_mapping(database, database.parent, out, options)
    return found


def test_exposure_becomes_a_model_of_its_motion(scene: Scene, database: Path, tmp_path: Path) -> None:
    (model,) = models(database, mapper_options(), tmp_path).values()
    assert model.num_reg_images() == 2 and model.num_points3D() > 0.9 * COUNT
    views = {image.name: image.cam_from_world() for image in model.images.values()}
    motion = views["a#close"] * views["a#open"].inverse()
    assert rotation_error(motion.rotation.matrix(), scene.R)[1] < 0.1
    assert motion.translation @ scene.t > 0  # open and close are not exchanged
    assert translation_direction_error_deg(motion.translation, scene.t) < 3
    (camera,) = model.cameras.values()
    assert camera.focal_length_x == pytest.approx(scene.K[0, 0], abs=1e-9)  # not refined
