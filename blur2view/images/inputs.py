"""What a user names, as photographs in order: files, folders, lists, videos; and what they are called."""

import codecs
import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from blur2view.errors import ImageError
from blur2view.images.image import PHOTOGRAPH_SUFFIXES
from blur2view.images.source import Source, frame_named
from blur2view.images.video import frame_numbers, is_video
from blur2view.input_files import read_regular, read_stream
from blur2view.output_files import is_ours, real_paths

STANDARD_INPUT, LIST, COMMENT = "-", "@", "#"
URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")
NO_TEXT = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]")  # what a photograph begins with, and no list holds
MAX_LIST_BYTES, MAX_LINES = 1 << 25, 250_000  # of a list: the frames of two hours


@dataclass(frozen=True, kw_only=True)
class Inputs:
    """The photographs of a call, in order, each once.

    Parameters
    ----------
    sources : list of Source
        The photographs; folders and videos that cannot be used are among them.
    roots : dict
        The folder that was given, of photographs that were found in one.
    refused : dict
        Why these sources cannot be used, a line each.
    lists : list of Path
        The files that named some.
    """

    sources: list[Source] = field(default_factory=list)
    roots: dict[Source, Path] = field(default_factory=dict)
    refused: dict[Source, str] = field(default_factory=dict)
    lists: list[Path] = field(default_factory=list)

    @property
    def one_video(self) -> bool:
        """Whether all that can be used, if anything can, are frames of one video."""
        there = [one for one in self.sources if one not in self.refused and os.path.isfile(one.path)]
        return all(one.frame is not None for one in there) and len({one.path for one in there}) <= 1

    @property
    def read(self) -> set[str]:
        """The files that are read, where their paths lead."""
        return real_paths([*(source.path for source in self.sources), *self.lists])

    def refuse(self, path: Path, line: str) -> None:
        """Add what cannot be used, and the line that says why."""
        self.sources.append(source := Source(path=path))
        self.refused[source] = line

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
    for word in _without_lists(words, stdin):
        path = Path(word)
        try:
            if URL.match(word) and not os.path.lexists(word):
                found.refuse(path, f"{word}: is no file here; download it first")
            elif is_video(path):
                _add_frames(found, path, frames)
            elif path.is_dir():
                _add_folder(found, path, recursive)
            else:
                found.sources.append(frame_named(word) or Source(path=path))
        except OSError as error:
            found.refuse(
                path, f"{path}: cannot be read ({error.strerror}); check the path and its permissions"
            )
    once: dict[tuple[str, int | None], Source] = {}
    for source in found.sources:
        place = os.path.join(os.path.realpath(source.path.parent), source.path.name)
        once.setdefault((place, source.frame), source)
    found.sources[:] = once.values()
    return found


def _without_lists(words: Sequence[str], stdin: BinaryIO | None) -> Iterator[str]:
    """Yield words, those of lists in place of the lists."""
    for word in words:
        if word == STANDARD_INPUT:
            yield from _lines("standard input", partial(read_stream, stdin or BytesIO(), MAX_LIST_BYTES))
        elif word.startswith(LIST):
            path = Path(word[1:])
            if not path.name:
                raise ImageError(f"{word}: name a list behind {LIST}, as {LIST}list.txt")
            for name in _lines(word[1:], partial(read_regular, path, MAX_LIST_BYTES), path.parent):
                beside = path.parent / name
                there = [p for p in (name, beside) if os.path.lexists(p)]
                if len({os.path.realpath(p) for p in there}) > 1:
                    raise ImageError(f"{path}: {name} is here and beside the list; name it with its folder")
                here = str(there[0]) if there else name
                yield str(beside) if not there and frame_named(str(beside)) else here
        else:
            yield word


def _lines(source: str, read: Callable[[], bytes], folder: Path | None = None) -> list[str]:
    """Return the names of a list, one on a line.

    A line that begins with # is a comment, and spaces about a name are none of it, unless a file is named so,
    here or in the ``folder`` of the list.
    """

    def exists(name: str) -> bool:
        return os.path.lexists(name) or (folder is not None and os.path.lexists(folder / name))

    try:
        content = read()
        if NO_TEXT.search(content[:4096]):
            raise ValueError("it is no UTF-8 text; a photograph itself is named by its file")
        text = os.fsdecode(content.removeprefix(codecs.BOM_UTF8))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        remedy = "name a file that holds one name on each line, or pipe them to -"
        raise ImageError(f"{source}: the list cannot be read ({reason}); {remedy}") from None
    lines = text.splitlines()
    if len(lines) > MAX_LINES:
        most = f"name at most {MAX_LINES} photographs in one call"
        raise ImageError(f"{source}: has {len(lines)} lines; {most}")
    names = [one if exists(one) else one.strip() for one in lines if one.strip()]
    names = [one for one in names if one[0] != COMMENT or exists(one)]
    if not names:
        raise ImageError(f"{source}: names no photograph; write one on each line")
    return names


def _add_frames(found: Inputs, video: Path, frames: Callable[[Path], range]) -> None:
    """Add the frames of a video; one that cannot be opened stays as it is, with the reason."""
    try:
        found.sources.extend(Source(path=video, frame=number) for number in frames(video))
    except ImageError as error:
        found.refuse(video, str(error))


def _add_folder(found: Inputs, folder: Path, recursive: bool) -> None:
    """Add the photographs of a folder by their names; OSError, and none of them, if it cannot be read.

    A subfolder that cannot be read is refused by itself.
    """
    unread: list[OSError] = []
    below = os.walk(folder, onerror=unread.append)
    os.scandir(folder).close()
    entries = [
        Path(here, name) for here, _, names in (below if recursive else _first(below)) for name in names
    ]
    entries.sort(key=_in_order)
    photographs = [path for path in entries if _is_photograph(path)]
    if not photographs and not unread:
        more = "name another folder" if recursive else "add --recursive for its subfolders"
        if video := next(filter(is_video, entries), None):
            more = f"name its video, {video}"
        found.refuse(folder, f"{folder}: holds no photograph; {more}")
    for path in photographs:
        found.sources.append(source := Source(path=path))
        found.roots[source] = folder
    for error in unread:
        line = f"{error.filename}: cannot be read ({error.strerror}); check its permissions"
        found.refuse(Path(error.filename), line)


def _first(walk: Iterator[tuple[str, list[str], list[str]]]) -> list[tuple[str, list[str], list[str]]]:
    return [next(walk)]


def _is_photograph(path: Path) -> bool:
    """Return whether a file of a folder is a photograph by its name, and no result of blur2view.

    So is a link that leads nowhere, whose failure names the remedy.
    """
    suffix = path.suffix.lower()
    if suffix not in PHOTOGRAPH_SUFFIXES or not (path.is_file() or (path.is_symlink() and not path.exists())):
        return False
    return suffix != ".png" or not is_ours(path)


def _in_order(path: Path) -> list[tuple[str, int, str]]:
    """Return what sorts names as a person does: frame_2 before frame_10."""
    parts = re.findall(r"(\D*)(\d*)", str(path))
    return [(text, int(number or 0), number) for text, number in parts]
