"""Which photographs of many to keep by their blur, the sharpest of all or of neighbours; and their files."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from itertools import groupby
from pathlib import Path

import cv2
import numpy as np

from blur2view.arrays import AnyArray, Array
from blur2view.errors import OutputError
from blur2view.images.source import Source, read_content
from blur2view.images.video import read_frame
from blur2view.output_files import write_file

FRAME_DIGITS = 5  # as ns-process-data names frames
THUMBNAIL_PX = 96  # width; the blur of a photograph is no pixel there
SAME_VIEW = 0.5
"""Least response of phase correlation of two thumbnails of one view. In RedKitchen's sequence those of frames
up to ten apart have 0.65 and more, of a still view through MPEG-4 0.99, any two of Kodak's 24 photographs at
most 0.35."""


def sharpest(lengths: Sequence[float | None], count: int) -> set[int]:
    """Return the indices of the ``count`` shortest smears; None, without texture, comes last."""
    return set(sorted(range(len(lengths)), key=lambda one: _rank(lengths[one]))[:count])


def sharpest_of_each(
    lengths: Sequence[float | None],
    series: Sequence[Hashable],
    size: int,
    view: Callable[[int], Array | None],
) -> set[int]:
    """Return the indices of the sharpest of every ``size`` photographs, and of each view among them.

    ``lengths`` are those of their smears, pixels, None without texture. ``series`` is the video or folder of
    each one; none of another is counted with it. ``view`` returns the thumbnail of one, asked for in order.
    """
    kept: set[int] = set()
    runs = [list(run) for _, run in groupby(range(len(series)), key=series.__getitem__)]
    for group in (run[first : first + size] for run in runs for first in range(0, len(run), size)):
        views = {one: view(one) for one in group}
        left = sorted(group, key=lambda one: _rank(lengths[one]))
        while left and (lengths[left[0]] is not None or kept.isdisjoint(group)):
            best, *left = left
            kept.add(best)
            left = [one for one in left if not same_view(views[best], views[one])]
    return kept


def _rank(length: float | None) -> float:
    return np.inf if length is None else length


def thumbnail(image: AnyArray) -> Array:
    """Return a photograph (H, W, 3) as a small grey picture (h, `THUMBNAIL_PX`), of mean 0."""
    height = max(round(THUMBNAIL_PX * image.shape[0] / image.shape[1]), 1)
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    small = cv2.resize(grey, (THUMBNAIL_PX, height), interpolation=cv2.INTER_AREA).astype(np.float64)
    return np.asarray(small - small.mean())


def same_view(first: Array | None, second: Array | None) -> bool:
    """Return whether two thumbnails show one view, shifted against each other by phase correlation."""
    if first is None or second is None or first.shape != second.shape or min(first.shape) < 2:
        return False
    window = cv2.createHanningWindow(first.shape[::-1], cv2.CV_64F)
    response = cv2.phaseCorrelate(first.copy(), second.copy(), window)[1]  # OpenCV 5 writes into both
    return bool(response >= SAME_VIEW)


def refuse_filled(folder: Path) -> None:
    """Raise OutputError for a folder that holds something: a program would read it with the pictures."""
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: is no folder; name another with --extract")
    if other := next(iter(sorted(folder.glob("*"))), None):
        raise OutputError(f"{folder}: holds {other.name}; name an empty folder with --extract")


def extract(folder: Path, names: Mapping[Source, str]) -> None:
    """Write photographs as they are, under these names, and frames of videos as PNG.

    Frame 120 of a video is ``frame_00120.png``, below the video's name if there are several. OutputError if a
    file cannot be written, ImageError if a photograph cannot be read.
    """
    several = len({one.path for one in names if one.frame is not None}) > 1
    for one, name in names.items():
        if one.frame is None:
            write_file(folder / name, read_content(one))
        else:
            below = folder / Path(name).parent if several else folder
            content = bytes(cv2.imencode(".png", read_frame(one.path, one.frame))[1])
            write_file(below / f"frame_{one.frame:0{FRAME_DIGITS}d}.png", content)
