"""A photograph that is a file, or a frame of a video; its content and its time."""

import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

import cv2

from blur2view.errors import ImageError
from blur2view.images.video import frame_numbers, is_video, read_frame
from blur2view.input_files import read_regular

DIGITS, MOST_DIGITS = 6, 18  # of the number by which a frame is named
UNIT_S = {10: 1.0, 13: 1e-3, 16: 1e-6, 19: 1e-9}
"""Seconds, by the digits of a whole number: those of our years since 1970 in s, ms, us and ns."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where a photograph is read from: a file as the user named it, or a frame of a video."""

    path: Path  # of the photograph, or of its video
    frame: int | None = None  # its number in the video, from 0
    time_s: float | None = field(default=None, compare=False)  # when it was taken, where that is known

    def __str__(self) -> str:
        return str(self.path) if self.frame is None else f"{self.path}/{self.name}"

    @property
    def name(self) -> str:
        """Return what it is called in its folder or video."""
        return self.path.name if self.frame is None else f"{self.frame:0{DIGITS}d}"

    @property
    def folder(self) -> Path:
        """Return the folder or video that it lies in."""
        return self.path.parent if self.frame is None else self.path

    def beside(self, steps: int) -> Self | None:
        """Return the frame so many behind this one in its video, if there may be one."""
        if self.frame is None or self.frame + steps < 0:
            return None
        return replace(self, frame=self.frame + steps, time_s=None)


def frame_named(word: str) -> Source | None:
    """Return the frame that VIDEO/000120 names by its number; None of any other word."""
    path = Path(word)
    if path.name.isdecimal() and len(path.name) <= MOST_DIGITS and is_video(path.parent):
        return Source(path=path.parent, frame=int(path.name))
    return None


def read_content(source: Path | Source) -> bytes:
    """Return the content of a photograph's file; of a frame of a video that of a picture with its pixels.

    ImageError if it cannot be read, EndOfVideo if the video announces more frames than it has.
    """
    path = source.path if isinstance(source, Source) else source
    if isinstance(source, Source) and source.frame is not None:
        return bytes(cv2.imencode(".bmp", read_frame(path, source.frame))[1])
    if is_video(path):
        frame_numbers(path)  # which says what is wrong, if anything is
        raise ImageError(f"{path}: is a video; read its frames with blur2view.read_video")
    try:
        return read_regular(path)
    except FileNotFoundError:
        raise ImageError(f"{path}: no such file; check the path") from None
    except IsADirectoryError:
        raise ImageError(f"{path}: is a folder; name a photograph in it") from None
    except OSError as error:
        reason = error.strerror
        raise ImageError(f"{path}: cannot be read ({reason}); check the path and its permissions") from None


def timestamp_of(name: str | os.PathLike[str]) -> float | None:
    """Return the seconds that a file is called by, None if its name is no time.

    A decimal fraction is seconds, as of TUM's recordings (``1305031102.175304.png``), a whole number of 10,
    13, 16 or 19 digits seconds, milli-, micro- or nanoseconds since 1970, as of EuRoC's and of ROS
    (``1403636579763555584.png``); anything else, as the number of a frame, is no time.
    """
    return _seconds(Path(name).stem)


def timestamps_of(paths: Iterable[str | os.PathLike[str]]) -> list[float]:
    """Return the seconds of photographs in order, as of `timestamp_of`; ImageError if one has no time."""
    found = []
    for path in paths:
        if (time := timestamp_of(path)) is None:
            raise ImageError(f"{path}: its name is no time; name it by one, as 1403636579.763.png")
        found.append(time)
    return found


def _seconds(text: str) -> float | None:
    """Return the seconds that a number stands for, None of any other text."""
    if re.fullmatch(r"\d{1,19}\.\d+", text):  # more would be no time, or infinite
        return float(text)
    return int(text) * UNIT_S[len(text)] if re.fullmatch(r"\d+", text) and len(text) in UNIT_S else None
