"""A photograph that is a file, or a frame of a video; and its content."""

import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

import cv2

from blur2view.errors import ImageError
from blur2view.images.video import frame_numbers, is_video, read_frame
from blur2view.input_files import read_regular

DIGITS, MOST_DIGITS = 6, 18  # of the number by which a frame is named


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where a photograph is read from.

    Parameters
    ----------
    path : Path
        The photograph's file as the user named it, or that of its video.
    frame : int or None
        Number of the frame in the video, from 0; None of a photograph.
    time_s : float or None
        When it was taken, seconds, where that is known; it distinguishes no sources.
    """

    path: Path
    frame: int | None = None
    time_s: float | None = field(default=None, compare=False)

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
        remedy = "check the path"
        if set(path.name) & set("*?[") or str(path).startswith("~"):
            remedy = "write patterns and ~ without quotes; no name fits"
        if path.is_symlink():
            remedy = f"it is a link to {os.readlink(path)}, fetch that (git annex get, dvc checkout)"
        raise ImageError(f"{path}: no such file; {remedy}") from None
    except IsADirectoryError:
        raise ImageError(f"{path}: is a folder; name a photograph in it") from None
    except OSError as error:
        reason = error.strerror
        raise ImageError(f"{path}: cannot be read ({reason}); check the path and its permissions") from None
