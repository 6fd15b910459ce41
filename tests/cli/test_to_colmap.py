"""``blur2view to-colmap``: what it prints and writes, and how it fails."""

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from PIL import Image

from blur2view.cli import commands as cli
from blur2view.colmap.mapping import mapper_options
from tests.cli.test_cli_camera import SIZE, picture_8_bit, smears
from tests.support.colmap_projects import ProjectOptions, check_database, make_project, user_rows
from tests.support.colour_code import colour_code, write_picture
from tests.support.many_photographs import exif_of

CAMERA = ("--camera", "PINHOLE 320 240 300 300 160 120")


@pytest.fixture
def photos(tmp_path: Path) -> list[Path]:
    """Return a picture in which the tiny network sees parallax, and one in which it sees no motion."""
    folder = tmp_path / "photos"
    folder.mkdir()
    moving = write_picture(folder / "moving.png", colour_code(smears(), 1.0))
    still = write_picture(folder / "still.png", colour_code(np.zeros((240, 320, 2)), 1.0))
    return [moving, still]


@pytest.fixture
def run(tiny_model: Path, capsys: pytest.CaptureFixture[str]) -> Any:
    """Return ``blur2view to-colmap`` with the tiny network: the code, stdout and stderr."""

    def call(*arguments: object) -> tuple[int, str, str]:
        code = cli.main(["to-colmap", "--model", str(tiny_model), "--jobs", "1", *map(str, arguments)])
        said = capsys.readouterr()
        return code, said.out, said.err

    return call


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Return a project that knows both pictures."""
    path = tmp_path / "project.db"
    make_project(path, ProjectOptions(images=2, features=400, size=SIZE))
    with closing(sqlite3.connect(path)) as database:
        database.execute(
            "UPDATE images SET name = CASE image_id WHEN 1 THEN 'moving.png' ELSE 'still.png' END"
        )
        database.commit()
    return path


def test_fresh_database(run: Any, photos: list[Path], tmp_path: Path) -> None:
    path = tmp_path / "new.db"
    code, out, err = run("--db", path, *CAMERA, *photos)
    assert (code, err) == (0, "")
    moving, still, total = out.splitlines()
    assert moving.startswith("moving.png: added, ") and "matches fit; order in time unknown" in moving
    assert still.startswith("still.png: added, no matches: ") and still.endswith(": sharp")
    assert total == f"{path}: wrote 4 images of 2 photographs"
    assert check_database(path) == []
    with pycolmap.Database.open(path) as database:
        assert len(database.read_two_view_geometry(1, 2).inlier_matches) > 60
        assert len(database.read_two_view_geometry(3, 4).inlier_matches) == 0


@pytest.mark.slow
def test_a_database_that_was_mapped_is_replaced_and_links_need_the_photographs(
    run: Any, photos: list[Path], tmp_path: Path
) -> None:
    path = tmp_path / "new.db"
    assert run("--db", path, *CAMERA, *photos)[0] == 0
    options = mapper_options()
    options.max_runtime_seconds = 1
    pycolmap.incremental_mapping(path, photos[0].parent, tmp_path, options)
    assert run("--db", path, *CAMERA, *photos)[0] == 0
    code, _, err = run("--db", path, "--link", *CAMERA, *photos)
    assert code == 1 and err.count("without --link") == 2 and "choose another --db" in err


def test_links_are_written_anew_and_what_is_the_users_stays(
    run: Any, photos: list[Path], project: Path
) -> None:
    before = user_rows(project)
    code, out, err = run("--db", project, "--link", *CAMERA, *photos)
    assert (code, err) == (0, "")
    assert user_rows(project) == before and check_database(project) == []
    assert f"backup {project}." in out
    code, out, _ = run("--db", project, "--link", "--no-backup", *CAMERA, *photos)
    assert code == 0 and "moving.png: replaced, " in out and "backup" not in out
    assert user_rows(project) == before
    assert len(list(project.parent.glob("*.bak"))) == 1


def test_pixels_are_those_of_the_file_as_it_is_stored(run: Any, photos: list[Path], tmp_path: Path) -> None:
    turned = photos[0].with_name("turned.jpg")
    exif = exif_of(orientation=6)  # upright it is 240 wide and 320 high
    Image.fromarray(picture_8_bit()).save(turned, quality=95, subsampling=0, exif=exif)
    code, out, err = run("--db", tmp_path / "new.db", *CAMERA, turned)
    assert (code, err) == (0, "") and "matches fit" in out
    with pycolmap.Database.open(tmp_path / "new.db") as database:
        camera = database.read_camera(1)
        assert (camera.width, camera.height) == (320, 240)
        assert database.read_keypoints(1)[:, 0].max() > 245
