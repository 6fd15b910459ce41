"""Views added to a project of the user: what is written, and that nothing of the user's changes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from blur2view.colmap.database import ProjectImage, plan_links, write_links
from blur2view.colmap.project import image_names, open_for_writing, smear_lengths
from blur2view.errors import DatabaseError
from blur2view.exposure.views import ExposureViews
from blur2view.geometry.epipolar import unit_norm
from tests.support.colmap_projects import (
    ProjectOptions,
    check_database,
    make_project,
    random_views,
    run_sql,
    user_rows,
)

FEATURES = 40
KINDS = [ProjectOptions(), ProjectOptions(wal=False), ProjectOptions(old=True), ProjectOptions(frames=False)]


def link(path: Path, *names: str, backup: bool = False) -> Path | None:
    plans = plan_links(path, [Path(name) for name in names])
    return write_links(path, [link_of(plan) for plan in plans], backup=backup)


def only_plan(path: Path, name: str = "a_001.jpg") -> ProjectImage | DatabaseError:
    (plan,) = plan_links(path, [Path(name)])
    return plan


def link_of(plan: ProjectImage | DatabaseError, seed: int = 0) -> tuple[ProjectImage, ExposureViews]:
    assert isinstance(plan, ProjectImage)
    rng = np.random.default_rng(seed)
    views = random_views(plan.name, FEATURES, rng)
    usable = views.geometry.inlier_mask | (rng.random(FEATURES) < 0.5)
    return plan, replace(views, usable=usable)


ROLLBACK = pytest.mark.parametrize("path", [ProjectOptions(wal=False)], indirect=True, ids=["journal"])


@pytest.mark.parametrize("kind", KINDS, ids=["wal", "journal", "old", "no frames"])
def test_user_rows_stay_and_pycolmap_reads_the_views(tmp_path: Path, kind: ProjectOptions) -> None:
    path = tmp_path / "project.db"
    make_project(path, kind)
    before, found = user_rows(path), check_database(path)
    assert found == []
    link(path, "a_000.jpg", "photos/a_002.jpg")
    assert user_rows(path) == before
    assert check_database(path) == []
    with pycolmap.Database.open(path) as database:
        images = {image.name: image.image_id for image in database.read_all_images()}
        assert len(images) == 7
        ids = [images[name] for name in ("a_000.jpg", "a_000.jpg#open", "a_000.jpg#close")]
        first, last = (database.read_keypoints(image_id) for image_id in ids[1:])
        views = link_of(only_plan(path, "a_000.jpg"))[1]
        np.testing.assert_allclose(first, views.points_open + 0.5, atol=1e-4)
        np.testing.assert_allclose(last, views.points_close + 0.5, atol=1e-4)
        assert views.usable is not None
        usable, used = np.flatnonzero(views.usable), np.flatnonzero(views.geometry.inlier_mask)
        for one, other in ((0, 1), (0, 2), (1, 2)):
            matches = database.read_matches(ids[one], ids[other])
            geometry = database.read_two_view_geometry(ids[one], ids[other])
            np.testing.assert_array_equal(matches, np.stack([usable] * 2, axis=1))
            np.testing.assert_array_equal(geometry.inlier_matches, np.stack([used] * 2, axis=1))
            assert geometry.F is not None and geometry.config == 3  # else calibrate_view_graph throws
        assert database.num_rigs() == (1 if kind.frames and not kind.old else 0)
    with pycolmap.Database.open(path) as database:  # what the mapper loads: throws where a frame is missing
        cache = pycolmap.DatabaseCache.create(database, pycolmap.DatabaseCacheOptions())
    assert {"a_000.jpg#open", "a_002.jpg#close"} <= {image.name for image in cache.images.values()}


def test_half_geometries_lead_from_the_photograph(path: Path) -> None:
    plan, views = link_of(only_plan(path))
    F = np.cross(np.eye(3), np.random.default_rng(0).normal(size=3))  # a translation: half has the same F
    views = replace(views, geometry=replace(views.geometry, F=F))
    write_links(path, [(plan, views)], backup=False)
    with pycolmap.Database.open(path) as database:
        geometries = [database.read_two_view_geometry(*pair).F for pair in ((2, 4), (2, 5), (4, 5))]
    to_open, to_close, whole = (unit_norm(np.asarray(found, float)) for found in geometries)
    np.testing.assert_allclose(to_close, whole, atol=1e-9)
    np.testing.assert_allclose(to_open, -whole, atol=1e-9)


def names_of(path: Path) -> dict[str, int]:
    with open_for_writing(path) as database:
        return image_names(database)


def test_linking_again_writes_views_anew_under_their_ids_also_beside_those_of_an_earlier_version(
    path: Path,
) -> None:
    before = user_rows(path)
    link(path, "a_000.jpg", "a_001.jpg")
    ids = names_of(path)
    run_sql(path, "ALTER TABLE blur2view_views DROP COLUMN smear_px")  # as of 0.2.0
    plan, views = link_of(only_plan(path), seed=1)
    write_links(path, [(plan, replace(views, smear_px=7.5))], backup=False)
    assert smear_lengths(path) == {"a_001.jpg": 7.5} and names_of(path) == ids and user_rows(path) == before
    assert check_database(path) == []
    with pycolmap.Database.open(path) as database:
        keypoints = database.read_keypoints(ids["a_001.jpg#open"])
    np.testing.assert_allclose(keypoints, views.points_open + 0.5, atol=1e-4)
