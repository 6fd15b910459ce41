"""What a user names, as photographs in order: files, folders, lists of names, videos."""

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
from blur2view.images.video import frame_numbers, frame_of, frame_path, is_video
from blur2view.input_files import read_regular, read_stream
from blur2view.output_files import below_shared_folder, is_ours, is_there

STANDARD_INPUT, LIST, COMMENT = "-", "@", "#"
URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")
NO_TEXT = re.compile(rb"[\x01-\x08\x0e-\x1a\x1c-\x1f]")  # what a photograph begins with, and no list holds
SHOWN = 3  # folders of a count
MAX_LIST_BYTES, MAX_LINES = 1 << 25, 250_000  # of a list: the frames of two hours


@dataclass(frozen=True, kw_only=True)
class Inputs:
    """The photographs of a call."""

    # in order, each once; VIDEO/000120 is a frame; folders and videos that cannot be used are among them
    paths: list[Path] = field(default_factory=list)
    # what results are called where a place in a folder or video says so: subfolder and stem
    names: dict[Path, Path] = field(default_factory=dict)
    refused: dict[Path, str] = field(default_factory=dict)  # why these cannot be used
    lists: list[Path] = field(default_factory=list)  # the files that named some

    @property
    def one_video(self) -> bool:
        """Whether all are frames of one video, and so in the order of time."""
        frames = [frame_of(path) for path in self.paths]
        return len({frame and frame[0] for frame in frames}) == 1 and frames[0] is not None

    @property
    def counted(self) -> str:
        """How many photographs there are, and in which folders and videos the most of them."""
        folders = Counter(path.parent for path in self.paths)
        shown = [f"{count} in {path}" for path, count in folders.most_common(SHOWN)]
        others = f" and {len(folders) - SHOWN} more folders" * (len(folders) > SHOWN)
        return f"{len(self.paths)} photographs: {', '.join(shown)}{others}"

    def is_folder(self, path: Path) -> bool:
        """Return whether this is a folder that cannot be used, and so no photograph."""
        return path in self.refused and os.path.isdir(path)

    def refuse(self, path: Path, reason: str) -> None:
        """Add what cannot be used."""
        self.paths.append(path)
        self.refused[path] = f"{path}: {reason}"


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
    taken; ``@LIST``, a file with one such word per line, ``-``, the same from standard input. What a list
    names and is not there is looked for in the list's folder. ImageError if a list cannot be read, names
    nothing, or is larger than one of photographs can be.
    """
    found = Inputs(lists=[Path(word[1:]) for word in words if word.startswith(LIST)])
    for word in _without_lists(words, stdin):
        path = Path(word)
        try:
            if URL.match(word) and not os.path.lexists(word):
                found.paths.append(path)
                found.refused[path] = f"{word}: is no file here; download it first"
            elif is_video(path):
                _add_frames(found, path, frames)
            elif path.is_dir():
                _add_folder(found, path, recursive)
            else:
                found.paths.append(path)
        except OSError as error:
            found.refuse(path, f"cannot be read ({error.strerror}); check the path and its permissions")
    once: dict[str, Path] = {}
    for path in found.paths:
        once.setdefault(os.path.join(os.path.realpath(path.parent), path.name), path)
    found.paths[:] = once.values()
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
            for name in _lines(word[1:], partial(read_regular, path, MAX_LIST_BYTES)):
                beside = path.parent / name
                there = [p for p in (name, beside) if os.path.lexists(p)]
                if len({os.path.realpath(p) for p in there}) > 1:
                    raise ImageError(f"{path}: {name} is here and beside the list; name it with its folder")
                yield str(there[0]) if there else name
        else:
            yield word


def _lines(source: str, read: Callable[[], bytes]) -> list[str]:
    """Return the names of a list, one on a line, or ended by null characters as of ``find -print0``.

    A line that begins with # is a comment, and spaces about a name are none of it, unless a file is named so.
    """
    try:
        content = read()
        if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            raise ValueError("it is UTF-16; save it as UTF-8")
        if NO_TEXT.search(content[:4096]):
            raise ValueError("it is no text; a photograph itself is named by its file")
        text = os.fsdecode(content.removeprefix(codecs.BOM_UTF8))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        remedy = "name a file that holds one name on each line, or pipe them to -"
        raise ImageError(f"{source}: the list cannot be read ({reason}); {remedy}") from None
    lines = text.split("\0") if "\0" in text else text.splitlines()
    if len(lines) > MAX_LINES:
        most = f"name at most {MAX_LINES} photographs in one call"
        raise ImageError(f"{source}: has {len(lines)} lines; {most}")
    names = [one for one in lines if one.strip()]
    if "\0" not in text:
        names = [one if os.path.lexists(one) else one.strip() for one in names]
        names = [one for one in names if one[0] != COMMENT or os.path.lexists(one)]
    if not names:
        raise ImageError(f"{source}: names no photograph; write one on each line")
    return names


def _add_frames(found: Inputs, video: Path, frames: Callable[[Path], range]) -> None:
    """Add the frames of a video; one that cannot be opened stays as it is, so that reading it says why."""
    try:
        paths = [frame_path(video, number) for number in frames(video)]
        found.names.update({path: Path(video.stem, path.name) for path in paths})
    except ImageError as error:
        paths = [video]
        found.refused[video] = str(error)
    found.paths.extend(paths)


def _add_folder(found: Inputs, folder: Path, recursive: bool) -> None:
    """Add the photographs of a folder by their names; OSError, and none of them, if it cannot be read."""
    entries = sorted(folder.rglob("*") if recursive else folder.iterdir(), key=_in_order)
    photographs = [
        path
        for path in entries
        if path.suffix.lower() in PHOTOGRAPH_SUFFIXES
        if path.is_file() or (path.is_symlink() and not path.exists())  # whose failure names the remedy
        if path.suffix.lower() != ".png" or not is_ours(path)  # as in a folder where results lie
    ]
    if not photographs:
        more = "name another folder" if recursive else "add --recursive for its subfolders"
        if video := next(filter(is_video, entries), None):
            more = f"name its video, {video}"
        found.refuse(folder, f"holds no photograph; {more}")
    found.paths.extend(photographs)
    for path in photographs:
        below = path.relative_to(folder)
        if len(below.parts) > 1:
            found.names[path] = below.with_suffix("")


def colmap_names(inputs: Inputs) -> dict[Path, str]:
    """Return the name of every photograph below the one folder that was given, or else that all share."""
    below = {path: name.parent / path.name for path, name in inputs.names.items() if name.parent != Path()}
    shared = below_shared_folder(inputs.paths)
    names = {path: name.as_posix() for path, name in zip(inputs.paths, shared, strict=True)}
    there = [path for path in inputs.paths if is_there(path)] or inputs.paths
    roots = {path.parents[len(name.parts) - 1] for path, name in below.items()}
    roots |= {path.parent for path in there if path not in below}
    if len(roots) == 1:
        (root,) = roots
        names |= {path: path.relative_to(root).as_posix() for path in names if path.is_relative_to(root)}
    return names


def _in_order(path: Path) -> list[tuple[str, int, str]]:
    """Return what sorts names as a person does: frame_2 before frame_10."""
    parts = re.findall(r"(\D*)(\d*)", str(path))
    return [(text, int(number or 0), number) for text, number in parts]
