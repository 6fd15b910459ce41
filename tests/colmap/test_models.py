"""COLMAP's models as anybody may have written them: whole ones are read, odd ones are refused in one line."""

import os
import struct
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from blur2view.colmap.models import find_model
from blur2view.errors import DatabaseError

NAMES = ("a.jpg", "b.jpg", "a.jpg#open")


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """Return the folder of a model of two photographs and a view, in binary files."""
    model, points = (
        pycolmap.Reconstruction(),
        np.random.default_rng(0).uniform([-1, -1, 4], [1, 1, 6], (9, 3)),
    )
    cameras = [
        pycolmap.Camera(model="SIMPLE_PINHOLE", width=100, height=80, params=[99, 50, 40], camera_id=number)
        for number in (1, 2, 3)
    ]
    rig = pycolmap.Rig(rig_id=1)  # of two cameras that take nothing
    rig.add_ref_sensor(cameras[0].sensor_id)
    rig.add_sensor(cameras[1].sensor_id, pycolmap.Rigid3d())
    for camera in cameras[:2]:
        model.add_camera(camera)
    model.add_rig(rig)
    model.add_camera_with_trivial_rig(cameras[2])
    for number, name in enumerate(NAMES, 1):
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(), np.array([0.1 * number, 0, 0]))
        image = pycolmap.Image(name=name, keypoints=np.ones((9, 2)), camera_id=3, image_id=number)
        model.add_image_with_trivial_frame(image, pose)
    for index, point in enumerate(points):
        track = pycolmap.Track()
        for number in range(1, len(NAMES) + 1):
            track.add_element(number, index)
        model.add_point3D(point, track, np.zeros(3, np.uint8))
    model.write_binary(tmp_path)
    return tmp_path


def test_a_whole_model_is_read_in_both_forms(model: Path) -> None:
    assert find_model(model).registered == 2
    (model / "text").mkdir()
    pycolmap.Reconstruction(model).write_text(model / "text")
    assert find_model(model / "text").registered == 2


@pytest.mark.parametrize(
    ("name", "at"),
    [
        *((f"{name}.bin", 0) for name in ("cameras", "images", "points3D", "frames", "rigs")),
        ("images.bin", 8 + 64 + len("a.jpg") + 1),
        ("points3D.bin", 8 + 43),
        ("frames.bin", 8 + 64),
        ("rigs.bin", 8 + 4),
    ],
)
@pytest.mark.parametrize("count", [struct.pack("<Q", 1 << 40), struct.pack("<Q", 1 << 29), b"\xff" * 8])
def test_a_count_that_no_file_holds_is_refused_before_memory_is_taken(
    model: Path, monkeypatch: pytest.MonkeyPatch, name: str, at: int, count: bytes
) -> None:
    if count == struct.pack("<Q", 1 << 40) and name in ("frames.bin", "rigs.bin") and at:
        count = b"\0\0\0\x10" * 2  # their inner counts have 32 bits
    data = bytearray((model / name).read_bytes())
    data[at : at + 8] = count
    (model / name).write_bytes(data)
    monkeypatch.setattr(pycolmap, "Reconstruction", lambda folder: pytest.fail("read"))
    with pytest.raises(DatabaseError, match="is no model that can be read"):
        find_model(model)


@pytest.mark.parametrize("name", ["images.bin", "points3D.bin", "frames.txt"])
def test_what_waits_for_ever_is_refused(model: Path, name: str) -> None:
    (model / name).unlink(missing_ok=True)
    os.mkfifo(model / name)
    with pytest.raises(DatabaseError, match="is no model that can be read"):
        find_model(model)


@pytest.mark.skipif(not Path("/proc/kmsg").exists(), reason="Linux alone has such files")
@pytest.mark.parametrize("name", ["images.bin", "points3D.txt", "other.txt"])
def test_what_waits_though_it_says_that_it_is_empty_is_refused(
    model: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (model / name).unlink(missing_ok=True)
    (model / name).symlink_to("/proc/kmsg")
    monkeypatch.setattr(pycolmap, "Reconstruction", lambda folder: pytest.fail("read"))
    with pytest.raises(DatabaseError, match="is no model that can be read"):
        find_model(model)


def test_a_name_without_an_end_is_refused(model: Path) -> None:
    data = (model / "images.bin").read_bytes()
    (model / "images.bin").write_bytes(data[:8] + data[8:72] + b"x" * 99)
    with pytest.raises(DatabaseError, match="is no model that can be read"):
        find_model(model)
