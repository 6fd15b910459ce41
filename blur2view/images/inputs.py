"""What a user names, as photographs in order: files, folders, lists, videos; and what they are called."""

import codecs
import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import BinaryIO

from blur2view.errors import ImageError
from blur2view.images.image import PHOTOGRAPH_SUFFIXES
from blur2view.images.source import Source, frame_named
from blur2view.images.video import frame_numbers, is_video
from blur2view.input_files import read_regular, read_stream
from blur2view.output_files import is_ours, real_paths

STANDARD_INPUT, LIST, COMMENT = "-", "@", "#"
MAX_LIST_BYTES = 1 << 25


@dataclass(frozen=True, kw_only=True)
class Inputs:
    """The photographs of a call, in order, each once.

    Folders and videos that cannot be used are among them.
    """

    sources: list[Source] = field(default_factory=list)
    roots: dict[Source, Path] = field(default_factory=dict)
    """The folder that was given, of photographs that were found in one."""
    refused: dict[Source, str] = field(default_factory=dict)
    """Why these sources cannot be used, a line each."""
    lists: list[Path] = field(default_factory=list)
    """The files that named some."""

    @property
    def one_video(self) -> bool:
        """Whether all that can be used, if anything can, are frames of one video."""
        there = [one for one in self.sources if one not in self.refused and os.path.isfile(one.path)]
        return all(one.frame is not None for one in there) and len({one.path for one in there}) <= 1

    @property
    def read(self) -> set[str]:
        """The files that are read, where their paths lead."""
        return real_paths([*(source.path for source in self.sources), *self.lists])

    def names(self) -> list[str]:
        """Return every photograph's path below the one folder that was given, or else that all share.

        So COLMAP names it; a frame of a video ``clip.mp4/000120``. One that is not there changes no other's.
        """
        there = [one for one in self.sources if os.path.isfile(one.path)] or self.sources
        roots = {os.path.abspath(self.roots.get(one, one.path.parent)) for one in there}
        root = os.path.commonpath(roots) if roots else ""
        return [_below(one, root) for one in self.sources]

    def result_names(self) -> list[Path]:
        """Return what the results of each photograph are called below a folder.

        By `names`, without the suffix unless two would be one.
        """
        names = [Path(*(part for part in Path(name).parts if part != "..")) for name in self.names()]
        short = [_without_suffix(name) for name in names]
        count = Counter(short)
        return [one if count[one] == 1 else name for one, name in zip(short, names, strict=True)]


def _below(source: Source, root: str | Path) -> str:
    """Return the path of a photograph as seen from a folder, with slashes."""
    path = Path(os.path.relpath(os.path.abspath(source.path), os.path.abspath(root))).as_posix()
    return path if source.frame is None else f"{path}/{source.name}"


def _without_suffix(path: Path) -> Path:
    """Return a name without the suffix of its file, or of the video that it lies in; that of ..jpg whole."""
    if path.name.isdecimal() and not path.suffix and path.parent.name:
        return _without_suffix(path.parent) / path.name
    return path.with_name(path.stem) if path.stem.strip(".") else path


def list_photographs(
    words: Sequence[str],
    *,
    recursive: bool = False,
    frames: Callable[[Path], range] = frame_numbers,
    stdin: BinaryIO | None = None,
) -> Inputs:
    """Return the photographs that words name.

    Words are files; folders, which stand for the photographs in them (with ``recursive`` for all below),
    without results of blur2view; videos, of which ``frames`` returns the numbers of the frames that are
    taken; ``VIDEO/000120``, a frame by its number; ``@LIST``, a file with one such word per line, ``-``, the
    same from standard input. What a list names and is not there is looked for in the list's folder.
    ImageError if a list cannot be read, names nothing, or is larger than one of photographs can be.
    """
    found = Inputs(lists=[Path(word[1:]) for word in words if word.startswith(LIST)])
    once: dict[tuple[str, int | None], Source] = {}
    for word in _without_lists(words, stdin):
        for source in _sources(found, word, recursive, frames):
            place = os.path.join(os.path.realpath(source.path.parent), source.path.name)
            once.setdefault((place, source.frame), source)
    found.sources.extend(once.values())
    return found


def _sources(found: Inputs, word: str, recursive: bool, frames: Callable[[Path], range]) -> Iterator[Source]:
    """Yield the photographs of one word; what cannot be used is among those refused, with its reason."""
    path = Path(word)
    try:
        if is_video(path):
            yield from [Source(path=path, frame=number) for number in frames(path)]
        elif path.is_dir():
            photographs, unread = _photographs(path, recursive)
            found.roots.update((source, path) for source in photographs)
            yield from photographs
            for error in unread:
                yield _refuse(found, Path(error.filename), error)
        else:
            yield frame_named(word) or Source(path=path)
    except (ImageError, OSError) as error:
        yield _refuse(found, path, error)


def _refuse(found: Inputs, path: Path, error: ImageError | OSError) -> Source:
    """Return a path as a source that is refused, with the reason."""
    line = f"{path}: cannot be read ({getattr(error, 'strerror', '')}); check the path and its permissions"
    found.refused[Source(path=path)] = str(error) if isinstance(error, ImageError) else line
    return Source(path=path)


def _photographs(folder: Path, recursive: bool) -> tuple[list[Source], list[OSError]]:
    """Return a folder's photographs, frame_2 before frame_10, and the errors of folders that cannot be read.

    So are links that lead nowhere, whose failure is named later, but not results of blur2view. ImageError if
    there are none.
    """
    unread: list[OSError] = []
    walked = islice(os.walk(folder, onerror=unread.append), None if recursive else 1)
    entries = [Path(here, name) for here, _, names in walked for name in names]
    found = [path for path in entries if path.suffix.lower() in PHOTOGRAPH_SUFFIXES]
    found = [path for path in found if path.suffix.lower() != ".png" or not is_ours(path)]
    if not found and not unread:
        more = "name another folder" if recursive else "add --recursive for its subfolders"
        raise ImageError(f"{folder}: holds no photograph; {more}")
    return [Source(path=path) for path in sorted(found, key=_in_order)], unread


def _in_order(path: Path) -> list[tuple[str, int, str]]:
    """Return what sorts names as a person does: frame_2 before frame_10."""
    parts = re.findall(r"(\D*)(\d*)", str(path))
    return [(text, int(number or 0), number) for text, number in parts]


def _without_lists(words: Sequence[str], stdin: BinaryIO | None) -> Iterator[str]:
    """Yield words, those of lists in place of the lists."""
    for word in words:
        if word == STANDARD_INPUT:
            yield from _lines("standard input", partial(read_stream, stdin or BytesIO(), MAX_LIST_BYTES))
        elif word.startswith(LIST):
            path = Path(word[1:])
            for name in _lines(str(path), partial(read_regular, path, MAX_LIST_BYTES)):
                beside = path.parent / name
                there = os.path.lexists(beside) or frame_named(str(beside)) is not None
                yield str(beside) if there and not os.path.lexists(name) else name
        else:
            yield word


def _lines(source: str, read: Callable[[], bytes]) -> list[str]:
    """Return the names of a list, one on a line but for blank ones and comments."""
    try:
        content = read()
        if b"\0" in content:
            raise ValueError("it is no text; a photograph itself is named by its file")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        remedy = "name a file that holds one name on each line, or pipe them to -"
        raise ImageError(f"{source}: the list cannot be read ({reason}); {remedy}") from None
    lines = map(str.strip, os.fsdecode(content.removeprefix(codecs.BOM_UTF8)).splitlines())
    names = [line for line in lines if line and not line.startswith(COMMENT)]
    if not names:
        raise ImageError(f"{source}: names no photograph; write one on each line")
    return names
