"""The angular velocities of a video as the log that Gyroflow stabilises it by, ``.gcsv`` 1.3.

Sources: docs.gyroflow.xyz, "GCSV format"; AdrianEddy/telemetry-parser, ``src/gyroflow/mod.rs``, which looks
for the header in the first 500 bytes. Of columns g and the orientation "XYZ" Gyroflow integrates the body's
rates (-gy, gx, gz) (``imu_integration/mod.rs``) along axes x right, y up and z backwards
(``stabilization/frame_transform.rs``): rates along our camera's x (right), y (down) and z (forwards) are
therefore (-y, -x, -z), which it calls "yxz" (``gyro_source/imu_transforms.rs``).
"""

import csv
import io
from collections.abc import Sequence

import numpy as np

from blur2view.arrays import Array
from blur2view.output_files import SIGNED_BY

TICK_S = 1e-6  # of the column of times
MOST_NAME = 200  # characters of the video's name, so that the header ends within 500 bytes


def gyroflow_log(times_s: Sequence[float], rates: Array, video: str) -> str:
    """Return the text of a ``.gcsv`` file, to be called as the video but for its ending.

    Of rates (N, 3), rad/s, as a gyroscope along the camera's axes x (right), y (down) and z (forwards) shows
    them, at times (N,), seconds. ValueError if these do not ascend.
    """
    if not (np.diff(times_s) > 0).all():
        raise ValueError("times must ascend")
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["GYROFLOW IMU LOG"])
    rows.writerows([("version", "1.3"), ("id", SIGNED_BY), ("orientation", "yxz")])
    rows.writerow(("videofilename", " ".join(video.split())[:MOST_NAME]))
    rows.writerows([("tscale", f"{TICK_S:f}"), ("gscale", "1.0")])
    rows.writerow(("t", "gx", "gy", "gz"))
    for time, rate in zip(times_s, rates, strict=True):
        rows.writerow((round(time / TICK_S), *(f"{value:z.6f}" for value in rate)))
    return text.getvalue()
