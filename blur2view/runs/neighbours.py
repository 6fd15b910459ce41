"""The photographs before and after each one in time, which decide the order in time of its own exposure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from blur2view.errors import ImageError
from blur2view.photographs.image import read_content
from blur2view.photographs.video import frame_of, frame_path


@dataclass(frozen=True, kw_only=True, eq=False)
class Neighbour:
    """A photograph before or after another one in time."""

    path: Path
    steps: int  # from the other one to it: -1 or 1
    content: bytes | None = None  # of its file, where it has been read already

    @property
    def encoded(self) -> bytes:
        """Return the file's content, read if need be; ImageError if it cannot be."""
        return read_content(self.path, beside=True) if self.content is None else self.content


def neighbours_of(paths: Sequence[Path], sequence: bool | None) -> dict[Path, tuple[Neighbour, ...]]:
    """Return the neighbours of each photograph, the earlier one first.

    Of a frame those beside it in its video; with ``sequence`` of other photographs those that are named
    beside them and lie in the same folder; if it is False none.
    """
    files = [path for path in paths if frame_of(path) is None] if sequence else []
    named = dict(enumerate(files)).get
    place = {path: index for index, path in enumerate(files)}
    neighbours: dict[Path, tuple[Neighbour, ...]] = {}
    for path in paths:
        beside = {}
        for steps in (-1, 1) if sequence is not False else ():
            if (frame := frame_of(path)) is not None and frame[1] + steps >= 0:
                beside[steps] = frame_path(frame[0], frame[1] + steps)
            elif path in place and (other := named(place[path] + steps)) and other.parent == path.parent:
                beside[steps] = other
        neighbours[path] = tuple(Neighbour(path=other, steps=steps) for steps, other in beside.items())
    return neighbours


def with_contents(neighbours: Iterable[Neighbour]) -> tuple[Neighbour, ...]:
    """Return neighbours with their contents, without those that cannot be read."""
    read: list[Neighbour] = []
    for one in neighbours:
        with suppress(ImageError):
            read.append(replace(one, content=one.encoded))
    return tuple(read)
