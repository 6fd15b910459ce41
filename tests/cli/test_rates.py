"""Rates from a video file to a table: signs, agreement of all that one document says, streams."""

import json
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from blur2view import Camera
from blur2view.arrays import Array
from blur2view.cli import commands as cli
from blur2view.geometry.epipolar import transfer
from blur2view.geometry.pose import rotation_flow, rotation_matrix, rotation_vector
from tests.results.test_gyroflow import parsed
from tests.support.calls import Call, table
from tests.support.many_photographs import write_frames, write_photographs

SIZE, FOCAL_PX, FRAMES_PER_S = (320, 240), 360.0, 25.0
OPEN = 0.8  # of the interval of frames
EXPOSURE_S = OPEN / FRAMES_PER_S
SUBFRAMES, PERIOD = 24, 16.0  # per exposure; frames of a swing
SWING: Array = np.array([0.03, 0.11, 0.05])  # radians about x, y and z
LAG: Array = np.array([1.0, 0.0, 2.0])
WALL = (1400, 1100)


class Swing(NamedTuple):
    """Frames (H, W, 3) uint8, RGB, and the rates (N, 3) of ``cam2_from_cam1``, radians per second."""

    frames: list[NDArray[np.uint8]]
    rates: Array

    def write(self, path: Path) -> Path:
        """Write the video, every frame compressed by itself: else one leaves its traces in the next."""
        frames = [np.ascontiguousarray(frame[..., ::-1]) for frame in self.frames]
        return write_frames(path, frames, "MJPG", FRAMES_PER_S)


def attitude(frame: float) -> Array:
    """Return cam_from_world (3, 3) at a time in frames."""
    return rotation_matrix(SWING * np.sin(2 * np.pi * frame / PERIOD + LAG))


def swing(count: int) -> Swing:
    """Render a video; sub-frames are averaged in linear light."""
    rng = np.random.default_rng(0)
    wall = np.zeros((*WALL[::-1], 3), np.float32)
    for scale, weight in ((1.2, 1.0), (5, 2.0), (20, 3.0)):
        noise = cv2.GaussianBlur(rng.normal(size=wall.shape).astype(np.float32), (0, 0), scale)
        wall += weight * noise / noise.std()
    linear = np.clip(0.5 + 0.14 * wall / wall.std(), 0, 1) ** 2.2
    K, wide = (
        np.array([[FOCAL_PX, 0, (w - 1) / 2], [0, FOCAL_PX, (h - 1) / 2], [0, 0, 1]]) for w, h in (SIZE, WALL)
    )
    frames, rates = [], []
    for index in range(count):
        times = index + OPEN * ((np.arange(SUBFRAMES) + 0.5) / SUBFRAMES - 0.5)
        views = [cv2.warpPerspective(linear, K @ attitude(t) @ np.linalg.inv(wide), SIZE) for t in times]
        frames.append(np.round(255 * np.mean(views, axis=0) ** (1 / 2.2)).astype(np.uint8))
        turned = attitude(index + OPEN / 2) @ attitude(index - OPEN / 2).T
        rates.append(rotation_vector(turned) / EXPOSURE_S)
    return Swing(frames, np.array(rates))


pytestmark = pytest.mark.slow
CAMERA = ("--focal", FOCAL_PX, "--exposure", EXPOSURE_S)
AXES = ("wx", "wy", "wz")
FRAMES = 18


@cache
def swinging() -> Swing:
    """Return a video of more than a period."""
    return swing(FRAMES)


def estimate(*words: object) -> int:
    """Run ``blur2view estimate`` with the shipped network."""
    return cli.main(["estimate", "--jobs", "1", *map(str, words)])


def rates_of(rows: list[Any]) -> Array:
    return np.array([[float(row[axis]) for axis in AXES] for row in rows])


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the video, its table and the files of its frames."""
    folder = tmp_path_factory.mktemp("swing")
    video = swinging().write(folder / "swing.avi")
    files = ("--csv", folder / "t.csv", "--gyroflow", folder / "swing.gcsv", "-o", folder / "out")
    assert estimate(video, *CAMERA, *files, "-q") == 0
    return folder


def test_rates_of_a_swinging_camera_have_their_signs_and_sizes(results: Path) -> None:
    whole, true = table(results / "t.csv"), swinging().rates
    moved = [index for index, row in enumerate(whole) if row["rate_unit"]]
    length_px = np.linalg.norm(true[:, :2], axis=1) * EXPOSURE_S * FOCAL_PX  # near the principal point
    assert {row["blur"] for row, px in zip(whole, length_px, strict=True) if px > 4} == {"camera moved"}
    assert "camera moved" not in {row["blur"] for row, px in zip(whole, length_px, strict=True) if px < 2}
    assert len(moved) >= 0.7 * FRAMES
    rows, true = [whole[index] for index in moved], true[moved]
    rates = rates_of(rows)
    assert (np.sum(rates * true, axis=1) > 0).mean() >= 0.98
    assert min(np.corrcoef(rates[:, axis], true[:, axis])[0, 1] for axis in range(3)) > 0.95
    assert np.median(np.linalg.norm(rates - true, axis=1)) < 0.15 * np.median(np.linalg.norm(true, axis=1))
    assert [int(row["frame"]) for row in whole] == list(range(FRAMES))
    stamps = [float(row["timestamp_s"]) for row in whole]
    np.testing.assert_allclose(stamps, np.arange(FRAMES) / FRAMES_PER_S, atol=1e-5)
    assert {row["rate_unit"] for row in rows} == {"rad/s"}
    assert np.mean([float(row["time_confidence"]) > 0.8 for row in rows]) > 0.9


def test_gyroflow_gets_what_a_gyroscope_on_the_camera_shows(results: Path) -> None:
    header, seconds, rates = parsed((results / "swing.gcsv").read_text())
    assert header["videofilename"] == "swing.avi"
    rows = [row for row in table(results / "t.csv") if row["rate_unit"] and float(row["time_confidence"]) > 0]
    np.testing.assert_allclose(seconds, [float(row["timestamp_s"]) for row in rows], atol=1e-5)
    x, y, z = -rates_of(rows).T  # about x right, y down, z forwards
    np.testing.assert_allclose(rates, np.column_stack([-y, -x, -z]), atol=1e-4)


def test_all_that_a_document_says_is_of_one_order_in_time(results: Path) -> None:
    rows = table(results / "t.csv")
    camera = Camera.from_focal(FOCAL_PX, SIZE)
    for row, path in zip(rows, sorted((results / "out" / "swing").glob("*.json")), strict=True):
        document = json.loads(path.read_text())
        if document["cam2_from_cam1"] is None:
            continue
        vector = rotation_vector(np.array(document["cam2_from_cam1"]["rotation"]))
        rate = np.array([document[axis] for axis in AXES])
        np.testing.assert_allclose(rate * EXPOSURE_S, vector)
        np.testing.assert_allclose(rates_of([row])[0], rate, rtol=1e-5)
        assert document["frame"] == int(row["frame"]) and document["time_known"] == (
            float(row["time_confidence"]) > 0
        )
        with np.load(path.with_suffix("").with_suffix(".smear.npz")) as arrays:
            ends = np.where(
                arrays["second_end_is_open"][:, None, None], arrays["ends"][:, ::-1], arrays["ends"]
            )
            ends = ends[arrays["inlier_mask"]]
        rays = camera.rays(ends)
        flow = np.tensordot(vector, rotation_flow(rays.mean(axis=1)), (0, 1)).T
        assert ((flow * (rays[:, 1] - rays[:, 0])).sum(axis=1) > 0).mean() > 0.95
        first, last = ends.swapaxes(0, 1)
        H = np.array(document["H"])
        assert (transfer(H, first, last) < transfer(H, last, first)).mean() > 0.95


def test_order_of_photographs_decides_the_sign_and_without_one_nothing_does(
    run: Call, tmp_path: Path
) -> None:
    names = [tmp_path / f"{name}.png" for name in "abc"]
    for name, frame in zip(names, swinging().frames[10:13], strict=True):
        cv2.imwrite(str(name), frame[..., ::-1])
    found: list[list[dict[str, Any]]] = []
    for words in ((*names, "--sequence"), (*names[::-1], "--sequence"), names):
        done = run(*words, *CAMERA, "--json", "--model", "default")
        found.append(done.document["estimates"])
    ahead, back, open_ = found
    np.testing.assert_allclose(rates_of(ahead), -rates_of(back[::-1]), atol=0.02)
    assert (np.sum(rates_of(ahead) * swinging().rates[10:13], axis=1) > 0).all()
    assert all(one["time_known"] for one in ahead + back) and not any(one["time_known"] for one in open_)
    assert ahead[0]["frame"] is None and ahead[0]["timestamp_s"] is None


def test_neighbour_that_cannot_be_read_costs_its_own_line_only(call: Call, tmp_path: Path) -> None:
    paths = write_photographs(tmp_path, 3)
    paths[1].write_bytes(b"no picture")
    for words, listed in ((["estimate", "--sequence"], "estimates"), (["segment"], "masks")):
        done = call(*words, *paths, "--json")
        assert len(done.document[listed]) == 2 and len(done.document["failures"]) == 1
        assert done == 1 and str(paths[1]) in done.line
