"""The angular velocities of a video as the log that Gyroflow stabilises it by, ``.gcsv`` 1.3.

Sources: docs.gyroflow.xyz, "GCSV format"; AdrianEddy/telemetry-parser, ``src/gyroflow/mod.rs``, which looks
for the header in the first 500 bytes. Of columns g and the orientation "XYZ" Gyroflow integrates the body's
rates (-gy, gx, gz) (``imu_integration/mod.rs``) along axes x right, y up and z backwards
(``stabilization/frame_transform.rs``): rates along our camera's x (right), y (down) and z (forwards) are
therefore (-y, -x, -z), which it calls "yxz" (``gyro_source/imu_transforms.rs``).
"""

import csv
import io
from collections.abc import Iterable

from blur2view.errors import OutputError
from blur2view.output import SIGNED_BY
from blur2view.records.record import Record

TICK_S = 1e-6  # of the column of times
MAX_NAME = 200  # characters of the video's name, so that the header ends within 500 bytes


def gyroflow_log(records: Iterable[Record], video: str) -> str:
    """Return the text of a ``.gcsv`` file, to be called as the video but for its ending.

    It holds what a gyroscope along the camera's axes shows, the negative of the scene's rates, rad/s, of the
    frames with a known direction of time. OutputError if there are none.
    """
    rates = dict[float, tuple[float | None, ...]]()
    every = list(records)
    if every and not any(frame.moved() or frame.wx is not None for frame in every):
        raise OutputError("no frame is blurred enough for a rate; choose a blurred part of the video")
    for frame in every:
        if frame.time_known and frame.exposure_s and frame.timestamp_s is not None and frame.wx is not None:
            rates[frame.timestamp_s] = frame.wx, frame.wy, frame.wz
    if not rates:
        raise OutputError(
            "no frame has a time, a rate and a known order in time; name a video, and add --focal and "
            "--exposure"
        )
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["GYROFLOW IMU LOG"])
    rows.writerows([("version", "1.3"), ("id", SIGNED_BY), ("orientation", "yxz")])
    rows.writerow(("videofilename", " ".join(video.split())[:MAX_NAME]))
    rows.writerows([("tscale", f"{TICK_S:f}"), ("gscale", "1.0")])
    rows.writerow(("t", "gx", "gy", "gz"))
    for time, rate in sorted(rates.items()):  # frames may be named in any order
        rows.writerow((round(time / TICK_S), *(f"{-(value or 0.0):z.6f}" for value in rate)))
    return text.getvalue()
