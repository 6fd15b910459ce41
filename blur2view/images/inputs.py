"""The photographs that a user names, in order, with their names: files, folders, lists, videos."""

import codecs
import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import BinaryIO, Self

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from blur2view.errors import ImageError
from blur2view.files import open_picture, read_regular, read_stream
from blur2view.images.image import PHOTOGRAPH_SUFFIXES, Content, read_content
from blur2view.images.video import SUFFIXES, frame_numbers, is_video, read_frame
from blur2view.output import is_ours, real_paths

STANDARD_INPUT, LIST, COMMENT = "-", "@", "#"
DIGITS, MAX_DIGITS = 6, 18  # of a frame's number: as it is written, and bound of what is read
LOOKED_AT = 1000  # folders below one without photographs; bound


@dataclass(frozen=True, kw_only=True)
class Source:
    """A photograph to read: a file as the user named it, or a frame of a video."""

    path: Path  # of the photograph, or of its video
    frame: int | None = None  # its number in the video, from 0
    time_s: float | None = field(default=None, compare=False)  # when it was taken, where that is known
    root: Path | None = field(default=None, compare=False)  # the folder that stands for it
    refusal: str = field(default="", compare=False)  # why it cannot be used, one line

    def __str__(self) -> str:
        return str(self.path) if self.frame is None else f"{self.path}/{self.name}"

    @property
    def name(self) -> str:
        """Its name in its folder or video."""
        return self.path.name if self.frame is None else f"{self.frame:0{DIGITS}d}"

    @property
    def folder(self) -> Path:
        """The folder or video that holds it."""
        return self.path.parent if self.frame is None else self.path

    def beside(self, steps: int) -> Self | None:
        """Return the frame this number of steps later in the video; None before the first, and of a file."""
        if self.frame is None or self.frame + steps < 0:
            return None
        return replace(self, frame=self.frame + steps, time_s=None)

    def read(self) -> Content:
        """Return the content of the file, of a frame its pixels.

        ImageError if it cannot be read, EndOfVideo if the video announces more frames than it has.
        """
        if self.frame is None:
            return read_content(self.path)
        return np.asarray(cv2.cvtColor(read_frame(self.path, self.frame), cv2.COLOR_BGR2RGB))

    def picture(self) -> bytes:
        """Return the content of a file with the pixels: of a photograph its own, of a frame a PNG."""
        content = self.read()
        return content if isinstance(content, bytes) else encode_png(content)


def encode_png(pixels: AnyArray) -> bytes:
    """Return the content of a PNG with these pixels (H, W, 3), RGB, uint8."""
    return bytes(cv2.imencode(".png", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR))[1])


def frame_file(number: int) -> str:
    """Return the name of a frame's PNG, as ns-process-data names frames."""
    return f"frame_{number:05d}.png"


def has_frames(path: Path) -> bool:
    """Return whether a file is a video, or an animated GIF, which is read as one."""
    if path.suffix.lower() != ".gif" or not path.is_file():
        return is_video(path)
    with suppress(Exception), open_picture(read_regular(path)) as picture:  # its errors have any type
        return bool(getattr(picture, "is_animated", False))
    return False


def frame_named(word: str) -> Source | None:
    """Return the frame that VIDEO/000120 names by its number; None of any other word."""
    path = Path(word)
    if path.name.isdecimal() and len(path.name) <= MAX_DIGITS and has_frames(path.parent):
        return Source(path=path.parent, frame=int(path.name))
    return None


@dataclass(frozen=True, kw_only=True)
class Inputs:
    """The photographs of a call, in order, each once; folders and videos that are refused are among them."""

    sources: list[Source] = field(default_factory=list)
    lists: list[Path] = field(default_factory=list)
    """The files that named some."""
    passed_over: list[Path] = field(default_factory=list)
    """Videos of folders that also hold photographs, which stand for the photographs alone."""

    @property
    def one_video(self) -> bool:
        """Whether all sources that can be used are frames of one video; also if there is none."""
        existing = [source for source in self.sources if not source.refusal and os.path.isfile(source.path)]
        frames_alone = all(source.frame is not None for source in existing)
        return frames_alone and len({source.path for source in existing}) <= 1

    @property
    def read(self) -> set[str]:
        """The real paths of the files that are read."""
        return real_paths([*(source.path for source in self.sources), *self.lists])

    def readable(self) -> Self:
        """Return the same photographs; ImageError if a folder or video among them is refused."""
        for source in self.sources:
            if source.refusal:
                raise ImageError(source.refusal)
        return self

    def names(self) -> list[str]:
        """Return the name of every photograph for COLMAP: its path below the folder that all share.

        That is the one folder that was named, or else the deepest one above all files that exist. A frame of
        a video is ``clip.mp4/000120``.
        """
        existing = [source for source in self.sources if os.path.isfile(source.path)] or self.sources
        roots = {os.path.abspath(source.root or source.path.parent) for source in existing}
        root = os.path.commonpath(roots) if roots else ""
        paths = [os.path.abspath(str(source)) for source in self.sources]
        return [Path(os.path.relpath(path, root)).as_posix() for path in paths]

    def result_names(self) -> list[Path]:
        """Return the name of every photograph's results below a folder.

        They are those of `names`, without the suffix unless two would be equal.
        """
        names = [Path(*(part for part in Path(name).parts if part != "..")) for name in self.names()]
        short = [_without_suffix(name) for name in names]
        count = Counter(short)
        return [stem if count[stem] == 1 else name for stem, name in zip(short, names, strict=True)]


def _without_suffix(path: Path) -> Path:
    """Return a name without the suffix of its file or video; one of dots and a suffix, as ..jpg, whole."""
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
    without results of blur2view, or, if there are none, for the videos; videos and animated GIFs, of which
    ``frames`` returns the numbers of the frames that are taken; ``VIDEO/000120``, a frame by its number;
    ``@LIST``, a file with one such word per line, ``-``, the same from standard input. A name in a list that
    does not exist is looked for in the list's folder.
    ImageError if a list cannot be read or names nothing.
    """
    once: dict[tuple[str, int | None], Source] = {}
    passed_over = list[Path]()
    for word in _without_lists(words, stdin):
        for source in _sources(word, recursive, frames, passed_over):
            location = os.path.join(os.path.realpath(source.path.parent), source.path.name)
            once.setdefault((location, source.frame), source)
    lists = [Path(word[1:]) for word in words if word.startswith(LIST)]
    named_paths = {source.path for source in once.values()}
    passed_over = [path for path in dict.fromkeys(passed_over) if path not in named_paths]
    return Inputs(sources=list(once.values()), lists=lists, passed_over=passed_over)


def photographs_in(folder: Path) -> Inputs:
    """Return the photographs of a folder, whatever it is called, and all below; ImageError without any."""
    photographs, _, unread = _listed(folder, recursive=True)
    if not photographs and not unread:
        raise ImageError(f"{folder}: holds no photograph; name another folder")
    return Inputs(sources=[*(Source(path=path, root=folder) for path in photographs), *unread])


def _sources(
    word: str, recursive: bool, frames: Callable[[Path], range], passed_over: list[Path]
) -> Iterator[Source]:
    """Yield the photographs of one word; folders and videos that cannot be used are refused with a reason.

    ``passed_over`` gets the videos of a folder that holds photographs.
    """
    path = Path(word)
    try:
        if has_frames(path):
            yield from [Source(path=path, frame=number) for number in frames(path)]
        elif path.is_dir():
            photographs, videos, unread = _listed(path, recursive)
            yield from [Source(path=photograph, root=path) for photograph in photographs]
            if photographs:
                passed_over += videos
            for video in () if photographs else videos:
                yield from _video_sources(video, path, frames)
            yield from unread
            if not (photographs or videos or unread):
                deeper = not recursive and _has_photographs_below(path)
                more = "add --recursive for its subfolders" if deeper else "name another folder"
                raise ImageError(f"{path}: holds no photograph or video; {more}")
        else:
            yield frame_named(word) or Source(path=path)
    except (ImageError, OSError) as error:
        yield _refused(path, error)


def _refused(path: Path, error: ImageError | OSError) -> Source:
    """Return a path as a source that is refused, with the reason."""
    line = f"{path}: cannot be read ({getattr(error, 'strerror', '')}); check the path and its permissions"
    return Source(path=path, refusal=str(error) if isinstance(error, ImageError) else line)


def _video_sources(video: Path, root: Path, frames: Callable[[Path], range]) -> list[Source]:
    """Return the frames of a video below the folder that was named, or its refusal."""
    try:
        return [Source(path=video, frame=number, root=root) for number in frames(video)]
    except (ImageError, OSError) as error:
        return [_refused(video, error)]


def _listed(folder: Path, recursive: bool) -> tuple[list[Path], list[Path], list[Source]]:
    """Return a folder's photographs, frame_2 before frame_10, its videos, and folders that cannot be read.

    Results of blur2view are left out, and what macOS puts beside files on foreign disks (._NAME); links that
    lead nowhere are not, so that their failure is named.
    """
    unread: list[OSError] = []
    walked = islice(os.walk(folder, onerror=unread.append), None if recursive else 1)
    listed = (Path(here, name) for here, _, names in walked for name in names)
    entries = sorted((path for path in listed if not path.name.startswith("._")), key=_in_order)
    videos = [path for path in entries if has_frames(path)]
    photographs = [
        path for path in entries if path.suffix.lower() in PHOTOGRAPH_SUFFIXES and path not in videos
    ]
    photographs = [path for path in photographs if path.suffix.lower() != ".png" or not is_ours(path)]
    return photographs, videos, [_refused(Path(error.filename), error) for error in unread]


def _has_photographs_below(folder: Path) -> bool:
    """Return whether there are photographs or videos below a folder, in the first `LOOKED_AT` ones."""
    names = (name for _, _, files in islice(os.walk(folder), LOOKED_AT) for name in files)
    return any(Path(name).suffix.lower() in (*PHOTOGRAPH_SUFFIXES, *SUFFIXES) for name in names)


def _in_order(path: Path) -> list[tuple[str, int, str]]:
    """Return the key that sorts names by their numbers: frame_2 before frame_10."""
    parts = re.findall(r"(\D*)(\d*)", str(path))
    return [(text, int(number or 0), number) for text, number in parts]


def _without_lists(words: Sequence[str], stdin: BinaryIO | None) -> Iterator[str]:
    """Yield the words, in place of a list those that it holds."""
    for word in words:
        if word != STANDARD_INPUT and not word.startswith(LIST):
            yield word
            continue
        path = None if word == STANDARD_INPUT else Path(word[1:])
        yield from _names(path, stdin)


def _names(path: Path | None, stdin: BinaryIO | None) -> list[str]:
    """Return what a list, or standard input, names, one on a line, without blank lines and comments.

    A name that begins with # or ends in a space is one if there is such a file.
    """
    source = "standard input" if path is None else str(path)
    try:
        content = read_stream(stdin or BytesIO()) if path is None else read_regular(path)
        if b"\0" in content:
            raise ValueError("it is not a text file; name a photograph without @")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        remedy = "name a file that holds one name on each line, or pipe such a list to -"
        raise ImageError(f"{source}: the list cannot be read ({reason}); {remedy}") from None
    names = []
    for line in os.fsdecode(content.removeprefix(codecs.BOM_UTF8)).split("\n"):
        name = line.removesuffix("\r")
        location = _path_in_list(name, path) or _path_in_list(name.strip(), path)
        if location or name.strip() and not name.strip().startswith(COMMENT):
            names.append(location or name.strip())
    if not names:
        raise ImageError(f"{source}: names no photograph; write one on each line")
    return names


def _path_in_list(name: str, path: Path | None) -> str | None:
    """Return where a name in a list is found: from here, or else from the list's folder; or None."""
    paths = [name] if path is None else [name, str(path.parent / name)]
    existing = (one for one in paths if os.path.lexists(one) or frame_named(one) is not None)
    return next(existing, None) if name else None
