"""Which frames are looked at closely where one of some neighbours is chosen.

Neighbours show the same things, so that gradients, which blur weakens, compare them well at a fraction of the
cost of the network: it reads the third of them with the most gradient energy.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from math import inf

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from blur2view.cli.jobs import Job
from blur2view.errors import ImageError
from blur2view.images.inputs import bitmap
from blur2view.images.video import frame_time, read_frame

NEIGHBOURS = (
    12  # bound: of so many at most gradients are compared, because they show the same things, and kept
)
SHARE = 3  # of so many neighbours the network reads one
SIDE_PX = 1280  # bound: of larger pictures the gradients are those of smaller copies


def gradient_energy(picture: AnyArray) -> float:
    """Return the mean squared gradient of a picture (H, W, 3), BGR, or (H, W), uint8: Tenengrad.

    J. M. Tenenbaum, Accommodation in Computer Vision, 1970. ``Sobel`` weighs by 8.
    """
    if (larger := max(picture.shape[:2]) / SIDE_PX) > 1:
        size = round(picture.shape[1] / larger), round(picture.shape[0] / larger)
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
    along = [cv2.Sobel(grey, cv2.CV_32F, *order) for order in ((1, 0), (0, 1))]
    return float(sum(cv2.norm(one, cv2.NORM_L2SQR) for one in along)) / 64 / grey.size


def candidates(groups: Iterable[Sequence[Job]]) -> Iterator[Job]:
    """Yield the jobs of each group that may be its sharpest, read, in order.

    Jobs that cannot be read, or whose file OpenCV does not decode, are always among them. Memory holds the
    contents of `NEIGHBOURS` photographs at most.
    """
    for group in groups:
        runs = -(-len(group) // NEIGHBOURS)
        for part in np.array_split(np.arange(len(group)), runs):
            yield from _sharper([group[k] for k in part])


def _sharper(jobs: Sequence[Job]) -> Iterator[Job]:
    """Yield the third of neighbours with the most gradient energy, and those that have none."""
    wanted = -(-len(jobs) // SHARE)
    read = [_read(job) for job in jobs] if len(jobs) > 1 else [(jobs[0], None, inf)]
    energies = sorted((energy for _, _, energy in read if energy < inf), reverse=True)
    least = energies[min(wanted, len(energies)) - 1] if energies else inf
    for job, pixels, energy in read:
        if energy >= least:
            yield job if pixels is None else replace(job, content=bitmap(pixels))


def _read(job: Job) -> tuple[Job, AnyArray | None, float]:
    """Return a job with its file's content or a frame's time, the frame's pixels, and the gradient energy."""
    source = job.source
    try:
        if job.refusal is not None:
            return job, None, inf
        if source.frame is None:
            job = replace(job, content=source.read())
            decoded = cv2.imdecode(np.frombuffer(job.content, np.uint8), cv2.IMREAD_GRAYSCALE)
            return job, None, inf if decoded is None else gradient_energy(np.asarray(decoded))
        pixels = read_frame(source.path, source.frame)
        time_s = frame_time(source.path, source.frame)
        return replace(job, source=replace(source, time_s=time_s)), pixels, gradient_energy(pixels)
    except (ImageError, cv2.error):  # which is said where it is read
        return job, None, inf
