"""Photographs and frames of videos as files in one folder, for programs that read nothing else."""

import os
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from pathlib import Path

import cv2

from blur2view.errors import OutputError
from blur2view.input_files import read_regular
from blur2view.output_files import write_files, writing
from blur2view.photographs.image import read_content
from blur2view.photographs.video import frame_of, read_frame

FRAME_DIGITS = 5  # as ns-process-data names frames


def extracted_names(names: Mapping[Path, str]) -> dict[Path, str]:
    """Return the file of each photograph below the folder, given what it is called elsewhere.

    A frame of a video is ``frame_00120.png`` by its number there, below the video's name if there are
    several.
    """
    frames = {path: frame for path in names if (frame := frame_of(path)) is not None}
    several = len({video for video, _ in frames.values()}) > 1
    digits = max([FRAME_DIGITS, *(len(str(number)) for _, number in frames.values())])
    files = dict(names)
    for path, (_, number) in frames.items():
        files[path] = f"{Path(names[path]).parent.as_posix()}/" * several + f"frame_{number:0{digits}d}.png"
    return files


def refuse_others(folder: Path, files: Iterable[str], besides: Collection[Path] = ()) -> None:
    """Raise OutputError for a folder with a file that is none of these: a program would read it with them."""
    ours = {os.path.realpath(folder / file) for file in files} | set(map(os.path.realpath, besides))
    for path in sorted(folder.rglob("*")) if folder.is_dir() else ():
        if not path.is_dir() and os.path.realpath(path) not in ours:
            raise OutputError(
                f"{folder}: holds {path.relative_to(folder)}; name an empty folder with --extract"
            )


def extract(folder: Path, files: Mapping[Path, str]) -> None:
    """Write photographs as they are, and frames of videos as PNG; a file of another content is not replaced.

    OutputError if there is one, or a file cannot be written; ImageError if a photograph cannot be read.
    """
    for path, name in files.items():
        target, frame = folder / name, frame_of(path)
        content = read_content(path) if frame is None else bytes(cv2.imencode(".png", read_frame(*frame))[1])
        if not os.path.lexists(target):
            with writing(target.parent):
                write_files({target: content})
            continue
        with suppress(OSError):
            if read_regular(target) == content:
                continue
        raise OutputError(f"{target}: is there with another content; name an empty folder with --extract")
