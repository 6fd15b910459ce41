"""How long each frame of a stream takes, from the picture in memory to the angular velocity.

``python -m tools.benchmarks.latency models/sample.jpg`` scales the photograph to each size, lets it drift,
and prints the median and the 95th percentile of the milliseconds for a frame by `estimate_frames`, and the
median of its processor time, which other programs do not lengthen: with the order in time, whose estimates
come one frame late, and without.
"""

import time
from collections.abc import Iterator
from itertools import product

import cv2
import numpy as np

import blur2view
from blur2view.arrays import AnyArray
from tools.arguments import Existing, Target, run
from tools.pages import joined, publish, table

SIZES, THREADS = ((640, 480), (1280, 720)), (1, 4)
WARM, DRIFT_PX = 2, 3  # frames that are not counted; from frame to frame
HEAD = "size | threads | order in time | frames | median, ms | 95 %, ms | processor, ms"


def drifting(picture: AnyArray, size: tuple[int, int], count: int) -> Iterator[AnyArray]:
    """Yield frames (H, W, 3) of a photograph that moves to the left."""
    wide = cv2.resize(picture, (size[0] + DRIFT_PX * count, size[1]), interpolation=cv2.INTER_AREA)
    for number in range(count):
        yield np.ascontiguousarray(wide[:, DRIFT_PX * number :][:, : size[0]])


def latencies_ms(
    picture: AnyArray, size: tuple[int, int], threads: int, ordered: bool, count: int
) -> AnyArray:
    """Return the milliseconds (count, 2) of any time and of the processor for an estimate with its rate."""
    network = blur2view.SmearNetwork(threads=threads)
    camera = blur2view.Camera.from_focal(0.9 * size[0], size)
    frames = list(drifting(picture, size, count + WARM + 1))
    found = blur2view.estimate_frames(frames, ordered=ordered, network=network, camera=camera)
    passed = []
    for _ in range(count + WARM):
        start = time.perf_counter(), time.process_time()
        next(found).angular_velocity(0.02)
        passed.append((time.perf_counter() - start[0], time.process_time() - start[1]))
    return 1000 * np.array(passed[WARM:])


def main(photograph: Existing, *, frames: int = 20, out: Target | None = None) -> None:
    """Print the table of so many frames of each kind."""
    picture = blur2view.read_image(photograph)
    rows = []
    for size, threads, ordered in product(SIZES, THREADS, (True, False)):
        passed, worked = latencies_ms(picture, size, threads, ordered, frames).T
        figures = [f"{one:.0f}" for one in (np.median(passed), np.quantile(passed, 0.95), np.median(worked))]
        rows.append((f"{size[0]}x{size[1]}", threads, "yes" if ordered else "no", len(passed), *figures))
    publish(joined(table(HEAD, rows)), out)


if __name__ == "__main__":
    run(main)
