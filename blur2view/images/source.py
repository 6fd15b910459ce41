"""A photograph that is a file, or a frame of a video."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

from blur2view.images.video import is_video

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
