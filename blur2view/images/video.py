"""Frames of videos, read in order by OpenCV."""

import os
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.errors import ImageError

# Videos that OpenCV's FFmpeg reads.
SUFFIXES = frozenset([".3gp", ".avi", ".m2ts", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".mts"])
SUFFIXES |= {".264", ".265", ".h264", ".h265", ".hevc", ".ogv", ".webm", ".wmv"}
# Containers round the number of frames: up to a second, or a quarter of the frames, that lacks at the end was
# never recorded (bound).
TAIL_S, TAIL_SHARE = 1.0, 0.25
NUMBERED = "name frames by their numbers, or give it one: ffmpeg -r 30 -i VIDEO -c copy a.mp4"
FILES_ONLY = "OPENCV_FFMPEG_CAPTURE_OPTIONS", "protocol_whitelist;file"  # no playlist opens the network
ROWS_TOWARDS = {90: (-1, 0), 180: (0, -1), 270: (1, 0)}  # by the degrees clockwise that OpenCV turns frames


class EndOfVideo(ImageError):
    """A video announces a frame that it does not have; ``whole`` says that no later frame was recorded."""

    whole = True


def is_video(path: Path) -> bool:
    """Return whether a file is a video by its name."""
    return path.suffix.lower() in SUFFIXES and path.is_file()


def rows_towards(video: Path) -> tuple[int, int]:
    """Return the direction in upright frames in which the sensor's rows follow each other."""
    degrees = round(_opened(video).get(cv2.CAP_PROP_ORIENTATION_META))
    return ROWS_TOWARDS.get(degrees % 360, (0, 1))


def frame_times(video: Path) -> list[float]:
    """Return the times in seconds at which frames are shown, in order, as the file states them, undecoded.

    A video that states no times has those of its frame rate; ImageError if it states none either, or cannot
    be opened.
    """
    times = _packet_times(_opened(video))
    if len(set(times)) == len(times) > 0:
        return sorted(times)
    reader = _Reader(video)
    if reader.rate <= 0:
        raise ImageError(f"{video}: states neither times nor a frame rate; {NUMBERED}")
    return [k / reader.rate for k in range(reader.count)]


def _packet_times(capture: Any) -> list[float]:
    """Return the times in seconds of packets, one a frame, as they are stored, undecoded, not in order."""
    times = list[float]()
    while capture.set(cv2.CAP_PROP_FORMAT, -1) and capture.grab():
        times.append(float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000)
    return times


def frame_numbers(
    video: Path, *, every: int = 1, first: int | float = 0, last: int | float | None = None
) -> range:
    """Return the numbers of frames, one of ``every``, from the first to the last, which is included.

    An integer names a frame by number, a float by seconds. ImageError if the video cannot be opened or has no
    frames there; ValueError for a negative frame, and unless ``every`` is 1 or more.
    """
    if every < 1 or first < 0 or (last is not None and last < 0):
        raise ValueError(f"expected every >= 1 and no negative frame, got {every}, {first} and {last}")
    reader = _Reader(video)
    count, rate = reader.count, reader.rate
    if not count:
        raise ImageError(f"{video}: has no frames that can be counted; convert it to MP4")
    if rate <= 0 and any(isinstance(number, float) for number in (first, last)):
        raise ImageError(f"{video}: states no frame rate; {NUMBERED}")
    begin, end = (
        number if isinstance(number, int) else round(min(number * rate, count))
        for number in (first, count - 1 if last is None else last)
    )
    if numbers := range(begin, min(end, count - 1) + 1, every):
        return numbers
    start, stop = (f"{one:g} s" if isinstance(one, float) else f"frame {one}" for one in (first, last))
    if begin >= count:
        of_time = f", which take {count / rate:.1f} s" if rate > 0 else ""
        why = f"has {count} frames{of_time}, and none from {start} on; name an earlier one"
    else:
        why = f"{start} comes after {stop}; swap them"
    raise ImageError(f"{video}: {why}")


def read_frame(video: Path, number: int) -> NDArray[np.uint8]:
    """Return a frame (H, W, 3), BGR, upright; fast where the frames of a video are read in order.

    ImageError if the video cannot be opened or does not announce the frame, EndOfVideo if it ends before.
    """
    return _reader(video).read(number)


def read_video(
    path: str | os.PathLike[str], *, every: int = 1, first: int | float = 0, last: int | float | None = None
) -> Iterator[NDArray[np.float32]]:
    """Return an iterator over frames of a video, (H, W, 3), float32 RGB in [0, 1], upright.

    One frame at a time is in memory.

    Parameters
    ----------
    path : path
        The video's file.
    every : int
        One frame in so many is taken.
    first, last : int or float, optional
        The first and the last frame, which is included: an integer is its number, a float its time in
        seconds. By default all.

    Returns
    -------
    iterator of ndarray of shape (H, W, 3)
        Frames in the order of time.

    Raises
    ------
    ImageError
        If the video cannot be read, ends too early or has no frames there.

    Examples
    --------
    >>> import cv2
    >>> import numpy as np
    >>> from blur2view import read_video
    >>> writer = cv2.VideoWriter("clip.avi", cv2.VideoWriter.fourcc(*"MJPG"), 25, (64, 48))
    >>> for grey in range(0, 250, 50):
    ...     _ = writer.write(np.full((48, 64, 3), grey, np.uint8))
    >>> writer.release()
    >>> [frame.shape for frame in read_video("clip.avi", every=2)]
    [(48, 64, 3), (48, 64, 3), (48, 64, 3)]
    """
    video = Path(path)
    numbers, reader = frame_numbers(video, every=every, first=first, last=last), _Reader(video)

    def frames() -> Iterator[NDArray[np.float32]]:
        try:
            for number in numbers:
                yield np.ascontiguousarray(reader.read(number)[..., ::-1], np.float32) / np.float32(255)
        except EndOfVideo as end:
            if not end.whole:
                raise

    return frames()


def frame_time(video: Path, number: int) -> float | None:
    """Return the time of a frame, seconds, None where the video states none; raises as `read_frame`."""
    return _reader(video).time_s(number)


class _Reader:
    """A video that is read forwards, as seeking is not exact with every codec."""

    def __init__(self, video: Path) -> None:
        self.video, self.capture, self.position, self.ended = video, _opened(video), 0, False
        self.timed = True
        self.count = int(self.capture.get(cv2.CAP_PROP_FRAME_COUNT))  # as announced
        self.rate = float(self.capture.get(cv2.CAP_PROP_FPS))  # frames a second, 0 if unknown
        if not 1 <= self.count <= video.stat().st_size:  # a frame takes more than a byte
            # a stream without a container, as x.h264: its rate is FFmpeg's guess, and it may have no times
            times = _packet_times(_opened(video))
            self.count, self.rate, self.timed = len(times), 0.0, len(set(times)) == len(times)
        self.shown_s = 0.0  # stamp of the current frame

    def read(self, number: int) -> NDArray[np.uint8]:
        """Return a frame (H, W, 3), BGR."""
        self._go_to(number)
        read, pixels = self.capture.retrieve()
        if not read:
            raise ImageError(f"{self.video}: frame {number} is damaged; copy the video again")
        return np.asarray(pixels, np.uint8)

    def time_s(self, number: int) -> float | None:
        """Return the time of a frame by its stamp, or else by the frames a second."""
        self._go_to(number)
        if not self.timed:
            return None
        if number == 0 or self.shown_s > 0:
            return max(self.shown_s, 0.0)
        return number / self.rate if self.rate > 0 else None

    def _go_to(self, number: int) -> None:
        """Make a frame the current one, whose pixels are converted when it is read."""
        if number < self.position - 1 or (self.ended and number < self.position):
            self.capture, self.position, self.ended = _opened(self.video), 0, False
        while self.position <= number:
            if self.ended or not self.capture.grab():
                self.ended = True  # frames behind damage have no known number
                raise self._end(number)
            self.position += 1
            self.shown_s = float(self.capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000

    def _end(self, number: int) -> ImageError:
        """Return the reason why there is no frame of this number."""
        if number >= self.count:
            line = f"has {self.count} frames, but none with the number {number}; name another one"
            return ImageError(f"{self.video}: {line}")
        line = f"ends after {self.position} of {self.count} frames; copy the video again"
        tail = min(TAIL_S * max(self.rate, 1.0), max(TAIL_SHARE * self.count, 1.0))
        end = EndOfVideo(f"{self.video}: {line}")
        # where the rate varies, Matroska's number is that of the mean rate, and the last frame's time tells
        lacks_s = self.count / self.rate - self.shown_s if self.rate > 0 else TAIL_S + 1
        end.whole = self.count - self.position <= tail or lacks_s <= TAIL_S
        return end


def _reader(video: Path) -> _Reader:
    """Return the reader of a video as it is now; the last one stays open."""
    with suppress(OSError):
        state = video.stat()
        return _cached_reader(video, state.st_size, state.st_mtime_ns)
    return _cached_reader(video, 0, 0)  # which says what is wrong


@lru_cache(maxsize=1)
def _cached_reader(video: Path, size: int, changed_ns: int) -> _Reader:
    return _Reader(video)


def _opened(video: Path) -> Any:
    """Open a video; ImageError if it is missing or damaged."""
    if not video.exists():
        raise ImageError(f"{video}: no such file; check the path")
    try:
        name = os.path.abspath(video)  # or FFmpeg takes what is before a colon for a protocol, as tcp:HOST
        name.encode()
    except UnicodeError:  # at which OpenCV ends the process
        raise ImageError(f"{video}: OpenCV cannot open its name, which is not UTF-8; rename it") from None
    os.environ.setdefault(*FILES_ONLY)  # which OpenCV reads whenever it opens a video
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # it would print what we raise
    capture = cv2.VideoCapture(name, cv2.CAP_FFMPEG)
    cv2.utils.logging.setLogLevel(level)
    if not capture.isOpened():
        remedy = "copy it again if it is damaged or cut off, convert it to MP4, or name a folder of frames"
        raise ImageError(f"{video}: cannot be opened as a video; {remedy}")
    return capture
