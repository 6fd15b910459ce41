"""``blur2view estimate`` with intrinsics: E, the pose and its rates in the document, and how it fails."""

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from PIL import Image

from blur2view.geometry.pose import rotation_vector
from tests.support.calls import Call, call_program
from tests.support.colour_code import colour_code, write_picture
from tests.support.many_photographs import exif_of, write_video

SIZE = (320, 240)
K = np.array([[300.0, 0, 159.5], [0, 300, 119.5], [0, 0, 1]])
TURN = np.array([0.004, -0.006, 0.003])  # radians about x, y, z
HEADING = np.array([0.1, -0.05, 1.0])


def smears() -> np.ndarray:
    """Return smears (H, W, 2) of a camera that goes forward and turns, past a scene of varying depth."""
    x, y = np.meshgrid((np.arange(SIZE[0]) - K[0, 2]) / 300, (np.arange(SIZE[1]) - K[1, 2]) / 300)
    nearness = 0.2 + 0.15 * np.sin(8 * x) * np.cos(9 * y)
    u = TURN[1] - TURN[2] * y - (TURN[0] * y - TURN[1] * x) * x + nearness * (HEADING[0] - HEADING[2] * x)
    v = TURN[2] * x - TURN[0] - (TURN[0] * y - TURN[1] * x) * y + nearness * (HEADING[1] - HEADING[2] * y)
    return 300 * np.stack([u, v], axis=-1)


def picture_8_bit() -> np.ndarray:
    """Return a picture (H, W, 3) uint8 in which the tiny network sees those smears."""
    return (np.clip(colour_code(smears(), 1.0), 0, 1) * 255).round().astype(np.uint8)


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    """Return a picture in which the tiny network sees those smears."""
    return write_picture(tmp_path / "photo.png", colour_code(smears(), 1.0))


@pytest.fixture
def run(call: Call) -> Any:
    """Return ``blur2view estimate --json`` with the tiny network: the documents."""
    return lambda *words: call("estimate", "--json", *words).document["estimates"]


@pytest.mark.parametrize(
    "camera", [["--focal", 300], ["--camera", "PINHOLE 320 240 300 300 160 120"]], ids=["focal", "string"]
)
def test_document_holds_the_pose(run: Any, photo: Path, camera: list[Any]) -> None:
    (document,) = run(photo, *camera, "--exposure", 0.05)
    assert document["config"] in ("PLANAR", "CALIBRATED")
    np.testing.assert_allclose(document["K"], K)
    assert document["camera"]["known"]
    R, t = (np.array(document["cam2_from_cam1"][key]) for key in ("rotation", "translation"))
    assert R.shape == (3, 3) and np.isclose(np.linalg.norm(t), 1)
    cosine = abs(t @ HEADING) / np.linalg.norm(HEADING)
    assert np.degrees(np.arccos(min(cosine, 1.0))) < 10
    F = np.linalg.inv(K).T @ np.array(document["E"]) @ np.linalg.inv(K)
    np.testing.assert_allclose(document["F"], F / np.linalg.norm(F), atol=1e-9)
    np.testing.assert_allclose([document[f"w{axis}"] for axis in "xyz"], rotation_vector(R) / 0.05)
    assert document["rate_unit"] == "rad/s" and not document["time_known"]


@pytest.mark.parametrize(
    "camera",
    [
        *("PINHOLE 320 240 1e9 1e9 160 120", "nonsense", "absent.db", "absent.db:1", "empty.db"),
        *("damaged.db", "damaged.db:1", "damaged.db:7"),
    ],
)
def test_a_camera_that_cannot_be_used_is_wrong_usage_however_it_is_stated(
    call: Call, photo: Path, here: Path, camera: str
) -> None:
    for name in ("damaged.db", "empty.db"):
        pycolmap.Database.open(here / name).close()
    with closing(sqlite3.connect(here / "damaged.db")) as database, database:
        params = np.array([1e9, 1e9, 160, 120]).tobytes()
        database.execute("INSERT INTO cameras VALUES (1, 1, 320, 240, ?, 1)", (params,))
    for words in (["estimate", photo], ["to-colmap", photo, photo, "--db", "new.db"]):
        done = call(*words, "--camera", camera)
        assert done == 2 and done.out == "" and done.line.startswith(f"blur2view {words[0]}: ")
    assert not Path("new.db").exists()


@pytest.mark.parametrize("camera", ["PINHOLE 320 240 1e9 1e9 160 120", "nonsense"])
def test_reconstruct_refuses_such_a_camera_alike(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, camera: str
) -> None:
    done = call_program(capsys, "reconstruct", tmp_path, "-o", tmp_path / "scene", "--camera", camera)
    assert done == 2 and "camera '" in done.line


def test_a_camera_of_another_shape_costs_one_photograph(call: Call, photo: Path, still: Path) -> None:
    done = call("estimate", photo, still, "--camera", "PINHOLE 320 240 300 300 160 120")
    assert done == 1 and f"{still}: camera (camera string) is for 320x240 pixels" in done.line


def test_frames_of_a_video_that_fail_for_one_reason_have_one_line_and_their_number(
    call: Call, tmp_path: Path
) -> None:
    words = ("estimate", write_video(tmp_path / "clip.mp4", 4), "--camera", "PINHOLE 9 3 9 9 4 1")
    done = call(*words)
    assert done == 1 and "000000: camera (camera string) is for 9x3 pixels" in done.lines[0]
    assert done.lines[1:] == [f"blur2view: {words[1]}: 3 more frames failed for the same reason (-v)"]
    assert len(call(*words, "-v").lines) == 4


def test_exif_is_taken_when_asked_and_a_hint_otherwise(run: Any, tmp_path: Path) -> None:
    exif = exif_of(FocalLengthIn35mmFilm=32, ExposureTime=0.1)
    Image.fromarray(picture_8_bit()).save(tmp_path / "photo.png", exif=exif)
    (taken,) = run(tmp_path / "photo.png", "--camera", "exif")
    focal = 32 * 400 / np.hypot(36, 24)
    assert np.isclose(taken["K"][0][0], focal) and taken["camera"]["known"]
    assert np.isclose(taken["exposure_s"], 0.1) and taken["rate_unit"] == "rad/s"
    (hinted,) = run(tmp_path / "photo.png")
    assert hinted["E"] is None and hinted["camera"]["known"] is False


def test_rows_follow_each_other_by_the_orientation_of_exif(run: Any, tmp_path: Path) -> None:
    pixels, angles = picture_8_bit(), {}
    as_stored = {1: pixels, 3: pixels[::-1, ::-1], 6: np.rot90(pixels), 2: pixels[:, ::-1]}
    for orientation, stored in as_stored.items():
        exif = exif_of(orientation=orientation, ExposureTime=0.02)
        path = tmp_path / f"{orientation}.png"
        Image.fromarray(np.ascontiguousarray(stored)).save(path, exif=exif)
        (document,) = run(path, "--focal", 300, "--readout", 0.03)
        other = np.array(document["backward"]["cam2_from_cam1"]["rotation"])
        angles[orientation] = document["rotation_deg"], np.degrees(np.linalg.norm(rotation_vector(other)))
    assert angles[2] == angles[1] != angles[6]
    np.testing.assert_allclose(angles[3], angles[1][::-1], rtol=0.1)
