"""``blur2view recover``: what it prints and writes, with the network that ships."""

import re
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pycolmap
import pytest
from PIL import Image

from blur2view.cli.recover import RecoverOptions
from blur2view.colmap.frame_sequence import FrameSequence, RecoveredFrame
from blur2view.errors import DatabaseError
from tests.support.blurred_plane import BlurredPlane
from tests.support.calls import call_program

PLANE = BlurredPlane(frames=7)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("video") / "plane"
    PLANE.write(folder, [0, 1, 2, 4, 5, 6])
    return folder


def test_registered_frames_may_not_all_be_posed_anew(
    video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["recover", video / "model", video / "frames", "-o", tmp_path / "all", "--max-smear"]
    done = call_program(capsys, *words, "0.1%")
    assert done == 1 and "fewer than two frames with shorter smears" in done.err
    assert not (tmp_path / "all").exists()


def test_frames_that_are_named_before_the_model_are_said_to_be(
    video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    done = call_program(capsys, "recover", video / "frames", video / "model", "-o", tmp_path / "all")
    assert done == 1 and f"{video / 'model'} has; name the model first" in done.err


def test_only_missing_frames_that_are_all_refused_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("blur2view.colmap.recovery_run.recover_all", lambda *_, **__: None)
    options: Any = RecoverOptions(model=Path("m"), frames_dir=Path("f"), output=Path("o"))
    notes: Any = SimpleNamespace(remove=lambda: None)
    sequence: Any = SimpleNamespace(refused={"a.png": "why"}, recovered={}, aside={"a.png": None}, source="m")
    assert not options._recover(sequence, notes, print)  # COLMAP's pose stays
    sequence.aside = {}
    with pytest.raises(DatabaseError, match="could not recover its missing frame; a.png: why"):
        options._recover(sequence, notes, print)


def test_every_frame_is_counted_and_written(
    video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["recover", video / "model", video / "frames", "-o", tmp_path / "all"]
    done = call_program(capsys, *words, "-v")
    assert done == 0
    printed = done.out.splitlines()
    assert printed[-1].startswith(f"{tmp_path / 'all'}: ")
    assert printed[-1].endswith(": of 7 frames 6 registered, 1 recovered, 0 refused")
    placed = r"recovered by \d+ points, which its pose puts 0\.\d px \(median\) from where they were found"
    assert re.fullmatch(f"{PLANE.names[3]} {placed}", printed[0])
    names = {image.name for image in pycolmap.Reconstruction(tmp_path / "all").images.values()}
    assert names == {*PLANE.names}
    assert call_program(capsys, *words, "--views") == 0
    names = {image.name for image in pycolmap.Reconstruction(tmp_path / "all").images.values()}
    assert names == {*PLANE.names, f"{PLANE.names[3]}#open", f"{PLANE.names[3]}#close"}
    onward = call_program(capsys, "to-transforms", tmp_path / "all", "-o", tmp_path / "t.json")
    assert onward == 0


def test_images_of_the_model_that_have_no_file_are_counted(
    video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = Path(shutil.copytree(video / "frames", tmp_path / "frames"))
    for name in PLANE.names[-2:]:
        (frames / name).unlink()
    done = call_program(capsys, "recover", video / "model", frames, "-o", tmp_path / "all", "--jobs", 1)
    line = f"{frames}: lacks 2 images of the model, the first of which is {PLANE.names[-2]}; "
    assert done == 0 and done.out.splitlines()[0].startswith(line)


def test_a_frame_with_alpha_is_recovered(
    video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "frames").mkdir()
    for path in (video / "frames").iterdir():
        Image.open(path).convert("RGBA").save(tmp_path / "frames" / path.name)
    done = call_program(
        capsys, "recover", video / "model", tmp_path / "frames", "-o", tmp_path / "all", "--jobs", 1
    )
    assert done == 0 and done.out.rstrip().endswith("6 registered, 1 recovered, 0 refused")


def test_ctrl_c_writes_what_is_recovered_and_the_same_call_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    BlurredPlane().write(tmp_path / "plane", [0, 1, 2, 5, 6, 7, 8])
    paths, output = (tmp_path / "plane" / "model", tmp_path / "plane" / "frames"), tmp_path / "all"
    try_frame = FrameSequence.try_frame

    def interrupted(sequence: FrameSequence, name: str) -> RecoveredFrame | str:
        if sequence.recovered:
            raise KeyboardInterrupt
        return try_frame(sequence, name)

    monkeypatch.setattr(FrameSequence, "try_frame", interrupted)
    done = call_program(capsys, "recover", *paths, "-o", output, "--jobs", 1)
    assert done == 130 and "interrupted with 1 frame left; the same call goes on" in done.line
    assert pycolmap.Reconstruction(output).num_reg_images() == 8
    monkeypatch.setattr(FrameSequence, "try_frame", try_frame)
    done = call_program(capsys, "recover", *paths, "-o", output, "--jobs", 1)
    assert done == 0 and ": of 9 frames 7 registered, 2 recovered, 0 refused" in done.out
    assert pycolmap.Reconstruction(output).num_reg_images() == 9 and not [*output.glob("*.jsonl")]


def test_database_that_is_there_is_not_replaced_by_tracks(
    video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tracks = tmp_path / "tracks.db"
    tracks.write_bytes(b"mine")
    words = ["recover", video / "model", video / "frames", "-o", tmp_path, "--tracks", tracks]
    done = call_program(capsys, *words)
    assert done == 1 and f"{tracks}: already exists; move it away" in done.line
    assert tracks.read_bytes() == b"mine" and list(tmp_path.iterdir()) == [tracks]
    done = call_program(capsys, *words[:-2], "--tracks", tmp_path / "none.db", "-o", tmp_path / "other")
    assert done == 1 and "none.db: no such database" in done.line and not (tmp_path / "other").exists()


def test_a_project_that_mappers_would_refuse_to_go_on_with_is_named_with_the_option(
    video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, project = shutil.copytree(video / "model", tmp_path / "model"), tmp_path / "project.db"
    camera = pycolmap.Camera(model="SIMPLE_PINHOLE", width=64, height=64, params=[64, 32, 32], camera_id=1)
    with pycolmap.Database.open(project) as opened:
        opened.write_camera(camera)
        opened.write_image(pycolmap.Image(name=PLANE.names[3], camera_id=1))
    (model / "project.ini").write_text(f"database_path={project}\n")
    done = call_program(capsys, "recover", model, video / "frames", "-o", tmp_path / "all", "--jobs", 1)
    assert done == 0
    words = f"for COLMAP to go on with this model and {project}, recover with --db {project}"
    assert done.out.splitlines()[-1] == words
