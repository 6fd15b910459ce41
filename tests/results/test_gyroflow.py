"""Gyroflow's log, parsed and integrated as Gyroflow does, against the camera that it is of."""

import csv
import io

import numpy as np

from blur2view.arrays import Array
from blur2view.geometry.pose import rotation_matrix
from blur2view.records.record import Record
from blur2view.results.gyroflow import gyroflow_log


def parsed(text: str) -> tuple[dict[str, str], Array, Array]:
    """Return header, seconds and radians per second after the orientation, as telemetry-parser reads them."""
    assert text[:16] == "GYROFLOW IMU LOG" and text.index("\nt,gx,gy,gz\n") < 500
    header: dict[str, str] = {}
    values: list[list[float]] = []
    for row in csv.reader(io.StringIO(text)):
        if len(row) == 2 and not values:
            header[row[0]] = row[1]
        elif len(row) >= 4 and row[0] != "t":
            values.append([float(value) for value in row])
    data = np.array(values)
    axes = {"X": data[:, 1], "Y": data[:, 2], "Z": data[:, 3]}
    turned = [axes[one.upper()] * (1 if one.isupper() else -1) for one in header["orientation"]]
    rates = np.column_stack(turned) * float(header["gscale"])
    return header, data[:, 0] * float(header["tscale"]), rates


def test_gyroflow_turns_the_camera_as_it_turned() -> None:
    rng = np.random.default_rng(0)
    times, seen = 0.01 + np.arange(30) / 30, rng.normal(0, 1, (30, 3))
    records = []
    for time, rate in zip(times.tolist(), seen, strict=True):  # the scene turns the other way
        rates = dict(zip(("wx", "wy", "wz"), (-rate).tolist(), strict=True))
        records.append(Record(name="", timestamp_s=time, exposure_s=0.02, time_known=True, **rates))
    header, seconds, g = parsed(gyroflow_log(records, "hall, 2.mp4"))
    assert header["version"] == "1.3" and header["videofilename"] == "hall, 2.mp4"
    np.testing.assert_allclose(seconds, times, atol=1e-6)
    ours = theirs = np.eye(3)  # world from camera: x right, y down; and x right, y up, as Gyroflow has it
    for rate, (x, y, z) in zip(seen, g, strict=True):
        ours = ours @ rotation_matrix(rate / 30)
        theirs = theirs @ rotation_matrix(np.array([-y, x, z]) / 30)
    flip = np.diag([1.0, -1, -1])  # frame_transform.rs
    np.testing.assert_allclose(flip @ theirs @ flip, ours, atol=1e-5)
