"""Views placed into a model of their photographs: an exact walk, a known exposure, photographs left out."""

import sqlite3
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from statistics import median_low

import numpy as np
import pycolmap
import pytest

from blur2view.arrays import Array
from blur2view.colmap.database import write_links
from blur2view.colmap.models import add_image
from blur2view.colmap.placement import NO_EXPOSURE, UNREGISTERED, Placement, place_views
from blur2view.errors import DatabaseError
from blur2view.exposure.views import ExposureViews
from blur2view.geometry.pose import rotation_vector
from tests.support.colmap_projects import some_views
from tests.support.walks import Walk

FRAMES, FEATURES, SHARE = 7, 60, 0.5
NAMES = [f"f_{k}.png" for k in range(7, 7 + FRAMES)]  # f_10 comes after f_9
TURN, MOVE = np.array([0.004, 0.012, -0.002]), np.array([0.05, 0.01, 0.02])
WALK = Walk(names=NAMES, size=(160, 120), focal=200.0, turn=TURN, move=MOVE)


def project(
    folder: Path,
    linked: Sequence[int] = range(FRAMES),
    share: float = SHARE,
    usable: int = FEATURES,
    wrong: int = 0,
    times: Sequence[float] = range(FRAMES),
) -> tuple[Path, Path]:
    """Write a model of a steady walk and its database, some with views."""
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, (FEATURES, 2)), rng.uniform(3, 8, FEATURES)])
    database, model = folder / "walk.db", folder / "model"
    WALK.write(points, database, {model: range(FRAMES)}, times)
    views = [smears(NAMES[k], times[k], points, share, usable) for k in linked]
    for one in views:
        one.points_open[:wrong] += 40.0
        one.points_close[:wrong] += 40.0
    write_links(database, views, backup=False)
    return database, model


def smears(name: str, time: float, points: Array, share: float, usable: int) -> ExposureViews:
    first, middle, last = (WALK.pixels(WALK.pose_at(time + k * share / 2), points) for k in (-1, 0, 1))
    plain = some_views(name, FEATURES)
    return replace(
        plain,
        size=WALK.size,
        points_open=middle - (last - first) / 2,
        points_close=middle + (last - first) / 2,
        geometry=replace(plain.geometry, inlier_mask=np.ones(FEATURES, bool)),
        usable=np.arange(FEATURES) < usable,
    )


def picture_motion(found: Placement, name: str) -> tuple[Array, Array]:
    by_name = {image.name: image for image in found.model.images.values()}
    step = by_name[name + "#close"].cam_from_world() * by_name[name + "#open"].cam_from_world().inverse()
    return rotation_vector(step.rotation.matrix()), step.translation


def test_a_steady_walk_gives_every_exposure_its_share_of_it(tmp_path: Path) -> None:
    found = place_views(*project(tmp_path, wrong=3))
    assert found.placed == tuple(NAMES) and found.refused == {}
    assert found.fraction == pytest.approx(SHARE, rel=0.02)
    for name in NAMES:
        turn, move = picture_motion(found, name)
        np.testing.assert_allclose(turn, SHARE * TURN, atol=2e-4)
        assert np.linalg.norm(move - SHARE * MOVE) < 0.1 * np.linalg.norm(SHARE * MOVE)
    assert found.model.num_reg_images() == 3 * FRAMES
    assert found.model.compute_mean_reprojection_error() < 0.2
    assert found.model.compute_num_observations() == FRAMES * (3 * FEATURES - 2 * 3)  # none by the wrong ones


@pytest.mark.parametrize(("share", "usable"), [(SHARE, 5), (0.0, FEATURES)], ids=["few", "still"])
def test_a_known_exposure_decides_where_smears_tell_none(tmp_path: Path, share: float, usable: int) -> None:
    found = place_views(*project(tmp_path, share=share, usable=usable), fraction=0.25)
    assert found.placed == tuple(NAMES) and found.fraction == 0.25
    np.testing.assert_allclose(picture_motion(found, NAMES[3])[0], 0.25 * TURN, atol=2e-4)


@pytest.mark.parametrize("lost", ["pose", "views"])
def test_photographs_apart_by_a_lost_one_do_not_follow_one_another(tmp_path: Path, lost: str) -> None:
    kept = [k for k in range(FRAMES) if k != 3]
    database, model = project(tmp_path, kept if lost == "views" else range(FRAMES))
    if lost == "pose":
        walk = pycolmap.Reconstruction(model)
        walk.deregister_frame(walk.images[4].frame_id)
        walk.write(model)
    found = place_views(str(database), str(model), NAMES)
    assert found.placed == tuple(NAMES[k] for k in kept)
    assert found.fraction == pytest.approx(SHARE, rel=0.02)  # 0.425 if 2 and 4 were neighbours


def test_every_linked_frame_is_placed_or_refused_with_the_reason(tmp_path: Path) -> None:
    database, model = project(tmp_path, [0, 1, 2, 4, 6])
    walk = pycolmap.Reconstruction(model)
    walk.deregister_frame(walk.images[2].frame_id)
    walk.write(model)
    found = place_views(database, model, [name for name in NAMES if name != NAMES[6]], fraction=0.5)
    assert found.placed == (NAMES[0], NAMES[2], NAMES[4])
    assert found.refused == {NAMES[1]: UNREGISTERED, NAMES[6]: "they are not in the folder of the frames"}
    with pytest.raises(DatabaseError, match="can be placed: they are not in the folder of the frames"):
        place_views(database, model, ["a.png"])


def spoil_keypoints(database: Path, model: Path, value: float) -> None:
    """Set all keypoints of views to one value."""
    with closing(sqlite3.connect(database)) as opened:
        row = np.full((FEATURES, 2), value, "<f4").tobytes()
        views = "SELECT image_id FROM images WHERE name LIKE '%#%'"
        opened.execute(f"UPDATE keypoints SET data = ?, cols = 2 WHERE image_id IN ({views})", (row,))
        opened.commit()


def spoil_focal(database: Path, model: Path, value: float) -> None:
    """Set the focal length of a model."""
    walk = pycolmap.Reconstruction(model)
    walk.cameras[1].params = [value, 80.0, 60.0]
    walk.write(model)


@pytest.mark.parametrize(
    ("spoil", "value"),
    [
        *((spoil_keypoints, value) for value in (0.0, 1e30, np.inf, np.nan)),
        *((spoil_focal, value) for value in (1e-300, 1e-6)),
    ],
)
def test_damaged_smears_show_no_exposure(
    tmp_path: Path, spoil: Callable[[Path, Path, float], None], value: float
) -> None:
    database, model = project(tmp_path)
    spoil(database, model, value)
    found = place_views(database, model)
    assert found.placed == () and set(found.refused.values()) == {NO_EXPOSURE}
    assert place_views(database, model, fraction=0.5).placed == tuple(NAMES)


@pytest.mark.parametrize(
    "numbers", [(3, 6, 16, 21, 24, 32, 41), (0, 9, 11, 20, 28, 31, 33)], ids=["of --every-best", "others"]
)
def test_frames_in_irregular_steps_are_placed_by_their_numbers(tmp_path: Path, numbers: list[int]) -> None:
    times = (np.array(numbers) - numbers[0]) / median_low(np.diff(numbers))
    database, model = project(tmp_path, times=times.tolist())
    walk = pycolmap.Reconstruction(model)
    names = {name: f"g_{number}.png" for name, number in zip(NAMES, numbers, strict=True)}
    with closing(sqlite3.connect(database)) as opened:
        for name, other in names.items():
            opened.execute("UPDATE images SET name = replace(name, ?, ?)", (name, other))
            opened.execute("UPDATE blur2view_views SET photograph = replace(photograph, ?, ?)", (name, other))
        opened.commit()
    for image in walk.images.values():
        image.name = names[image.name]
    walk.write(model)
    found = place_views(database, model)
    assert found.placed == tuple(names.values()) and found.fraction == pytest.approx(SHARE, rel=0.02)
    for name in names.values():
        np.testing.assert_allclose(picture_motion(found, name)[0], SHARE * TURN, atol=2e-4)


def test_colmap_goes_on_where_a_frame_was_refused(tmp_path: Path) -> None:
    database, model = project(tmp_path)
    walk = pycolmap.Reconstruction(model)
    walk.deregister_frame(walk.images[3].frame_id)
    walk.write(model)
    found = place_views(database, model)
    with pycolmap.Database.open(database) as opened:
        for image in found.model.images.values():
            stored = opened.read_image_with_name(image.name)
            assert stored is not None and stored.frame_id == image.frame_id
    (tmp_path / "onward").mkdir()
    onward = pycolmap.triangulate_points(found.model, database, tmp_path, tmp_path / "onward")
    assert onward.num_reg_images() == found.model.num_reg_images() == 3 * (FRAMES - 1)


def test_recovered_frames_and_other_numbers_of_images_are_no_obstacle(tmp_path: Path) -> None:
    database, model = project(tmp_path)
    walk = pycolmap.Reconstruction(model)
    lost, first = walk.images[3], walk.images[1]
    pose, name = lost.cam_from_world().matrix(), lost.name
    walk.deregister_frame(lost.frame_id)
    walk.tear_down()
    for end in ("", "#open", "#close"):
        add_image(walk, name + end, pose, np.ones((5, 2)), first)  # as recover_frames does
    walk.write(model)
    found = place_views(database, model)
    assert found.refused == {name: "the model has their views already"}
    assert found.placed == tuple(one for one in NAMES if one != name)
    assert found.fraction == pytest.approx(SHARE, rel=0.02)
