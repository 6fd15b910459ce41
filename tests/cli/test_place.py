"""From a video's frames to transforms.json: extracted, linked, placed, written, and read as programs do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest

from blur2view.arrays import Array
from blur2view.cli import commands as cli
from blur2view.output import NOTES
from tests.support.colour_code import colour_code
from tests.support.many_photographs import write_frames
from tests.support.walks import Walk, on_plane

FRAMES, SHARE, FOCAL, SIZE, EXPOSURE_S = 7, 0.5, 300.0, (320, 256), 0.02
TURN, MOVE = np.array([0.004, 0.02, -0.003]), np.array([0.25, 0.02, 0.05])  # a frame
NORMAL, DISTANCE = np.array([0.25, 0.1, 1.0]), 5.0  # of the wall that the camera passes
CENTRE = (np.array(SIZE) - 1) / 2
NAMES = [f"frame_{k:05d}.png" for k in range(FRAMES)]
WALK = Walk(names=NAMES, size=SIZE, focal=FOCAL, turn=TURN, move=MOVE)


def on_wall(pose: Array, at: Array) -> Array:
    """Return the points (N, 3) of the wall that a camera sees at pixels (N, 2)."""
    rays = np.column_stack([(at - CENTRE) / FOCAL, np.ones(len(at))])
    return on_plane(pose, rays, NORMAL, DISTANCE)


def write_clip(path: Path) -> Path:
    """Return a video, without loss, in whose frames the tiny network sees the true smears of the walk."""
    grid = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), -1).reshape(-1, 2).astype(float)
    pictures = []
    for k in range(FRAMES):
        points = on_wall(WALK.pose_at(k), grid)
        first, last = (WALK.pixels(WALK.pose_at(k + side * SHARE / 2), points) for side in (-1, 1))
        picture = colour_code((last - first).reshape(*SIZE[::-1], 2), 1.0)
        pictures.append(np.round(np.clip(picture, 0, 1) * 255).astype(np.uint8))
    return write_frames(path, pictures, "FFV1")


@pytest.fixture(scope="module")
def linked(tiny_model: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with frames of a video, in one of an odd name, and their project with views."""
    folder = tmp_path_factory.mktemp("chain")
    clip, frames = write_clip(folder / "clip.avi"), folder / "shots of day 1"
    run = ("--model", tiny_model, "--jobs", 1, "-q")
    assert call("triage", clip, "--best", 100, "--extract", frames, *run) == 0
    assert sorted(path.name for path in frames.iterdir()) == NAMES
    at = np.random.default_rng(0).uniform(20, np.array(SIZE) - 20, (150, 2))
    models = {folder / "model" / "0": range(3), folder / "model" / "1": range(FRAMES)}
    WALK.write(on_wall(WALK.pose_at(FRAMES // 2), at), folder / "project.db", models)
    assert call("to-colmap", "--db", folder / "project.db", "--link", "--sequence", frames, *run) == 0
    return folder


def call(*words: object) -> int:
    return cli.main(list(map(str, words)))


def place(folder: Path, *more: object, output: str = "with_views") -> int:
    frames = folder / "shots of day 1"
    return call("place", folder / "project.db", folder / "model", frames, "-o", folder / output, *more)


def in_opengl(pose: Array) -> Array:
    """Return world_from_camera (4, 4), y up, of a true pose."""
    return np.linalg.inv(np.vstack([pose, [0, 0, 0, 1]])) @ np.diag([1.0, -1, -1, 1])


@pytest.mark.slow
def test_chain_ends_in_files_that_both_programs_read(
    linked: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert place(linked) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith(
        f"{linked / 'with_views'}: {linked / 'model' / '1'} with views: 7 frames placed, 0 "
    )
    assert float(line.split()[-1]) == pytest.approx(SHARE, abs=0.03)
    ngp, splat = linked / "ngp" / "transforms.json", linked / "splat" / "transforms.json"
    assert call("to-transforms", linked / "with_views", "-o", ngp) == 0
    words = ("--dialect", "nerfstudio", "--exposure", EXPOSURE_S, "-o", splat)
    assert call("to-transforms", linked / "with_views", *words) == 0
    expected = "wrote 7 frames and their points, sparse_pc.ply"
    assert capsys.readouterr().out.endswith(f"{splat}: {expected}\n")
    for path in (ngp, splat):
        for k, frame in enumerate(json.loads(path.read_text())["frames"]):
            assert (path.parent / frame["file_path"]).is_file()
            np.testing.assert_allclose(frame["transform_matrix"], in_opengl(WALK.pose_at(k)), atol=0.02)
    assert {path.name for path in ngp.parent.iterdir()} == {"transforms.json", NOTES}
    assert place(linked, "-q") == 0 and place(linked, output="model/1") == 1
    assert "1: would replace the model of this call; name another folder with -o" in capsys.readouterr().err


def test_what_cannot_be_placed_is_one_line(
    linked: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def complaint(*words: object) -> str:
        assert call("place", *words, "-o", tmp_path / "out") == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert not (tmp_path / "out").exists()
        return line

    database, frames = linked / "project.db", linked / "shots of day 1"
    assert "no such folder; name the folder of the frames" in complaint(
        database, linked / "model", tmp_path / "none"
    )
    assert "no such folder; name the folder with cameras.bin" in complaint(
        database, tmp_path / "none", frames
    )
    assert "no such database" in complaint(tmp_path / "none.db", linked / "model", frames)
    one = pycolmap.Reconstruction(linked / "model" / "1")
    for k in range(2, FRAMES + 1):
        one.deregister_frame(one.images[k].frame_id)
    (tmp_path / "one").mkdir()
    one.write(tmp_path / "one")
    for words in ((), ("--fraction", 0.5)):
        assert "none follows another one" in complaint(database, tmp_path / "one", frames, *words)


def test_pictures_that_are_not_there_are_asked_for(
    linked: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert place(linked, "-q", output="moved") == 0
    (linked / "moved" / "project.ini").write_text("# by blur2view place\nimage_path=/nowhere\n")
    target = tmp_path / "t.json"
    words: tuple[Any, ...] = ("to-transforms", linked / "moved", "-o", target)
    assert call(*words) == 1
    assert "name their folder with --images" in capsys.readouterr().err and not target.exists()
    assert call(*words, "--images", linked / "shots of day 1") == 0
