"""The angular velocities of a video as the log that Gyroflow stabilises it by, ``.gcsv`` 1.3.

Sources: docs.gyroflow.xyz, "GCSV format"; AdrianEddy/telemetry-parser, ``src/gyroflow/mod.rs``, which looks
for the header in the first 500 bytes; gyroflow/gyroflow, ``src/core``. Of the columns g and the orientation
"XYZ" Gyroflow integrates the body's rates (-gy, gx, gz) (``imu_integration/mod.rs``) along axes x right, y up
and z backwards (the signs of ``stabilization/frame_transform.rs``): those of a gyroscope along our camera's x
(right), y (down) and z (forwards) are therefore (-y, -x, -z), which it calls "yxz"
(``gyro_source/imu_transforms.rs``).
"""

import csv
import io
from collections.abc import Sequence

import numpy as np

from blur2view.arrays import Array
from blur2view.output_files import SIGNED_BY

ORIENTATION = "yxz"
TICK_S = 1e-6  # of the column of times
MOST_NAME = 200  # characters of the video's name, so that the header ends within 500 bytes


def gyroflow_log(times_s: Sequence[float], rates: Array, video: str) -> str:
    """Return the text of a ``.gcsv`` file, to be called as the video but for its ending.

    Parameters
    ----------
    times_s : sequence of N floats
        Mid exposure of each frame, seconds from the video's beginning; they ascend.
    rates : ndarray of shape (N, 3)
        What a gyroscope along the camera's axes x (right), y (down) and z (forwards) shows, radians per
        second: ``AngularVelocity.of_gyroscope.mean``. Leave out frames whose direction of time is unknown.
    video : str
        The video's name.

    Raises
    ------
    ValueError
        If the shapes differ, or a number is not finite.
    """
    times = np.asarray(times_s, float)
    if rates.shape != (len(times), 3) or not (np.isfinite(times).all() and np.isfinite(rates).all()):
        raise ValueError(f"expected finite times (N,) and rates (N, 3), got {times.shape} and {rates.shape}")
    if (np.diff(times) <= 0).any():
        raise ValueError("times must ascend")
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["GYROFLOW IMU LOG"])
    rows.writerows([("version", "1.3"), ("id", SIGNED_BY), ("orientation", ORIENTATION)])
    rows.writerow(("videofilename", " ".join(video.split())[:MOST_NAME]))
    rows.writerows([("tscale", f"{TICK_S:f}"), ("gscale", "1.0")])
    rows.writerow(("t", "gx", "gy", "gz"))
    rows.writerows(
        (round(time / TICK_S), *(f"{value:z.6f}" for value in rate))
        for time, rate in zip(times, rates, strict=True)
    )
    return text.getvalue()
