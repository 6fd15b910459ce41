"""The content of a photograph's file, or of a frame of a video; what is not there has its remedy."""

import os
import re
from contextlib import suppress
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path

import cv2

from blur2view.errors import ImageError
from blur2view.images.source import Source
from blur2view.images.video import frame_numbers, is_video, read_frame
from blur2view.input_files import read_regular

MOST_LIKE_IT = 200
"""Names of a folder, with the same digits, up to which one that is not there is compared: 1 ms each time."""


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
        if near := _near(path):
            remedy = f"did you mean {near}?"
        if path.is_symlink():
            remedy = f"it is a link to {os.readlink(path)}, fetch that (git annex get, dvc checkout)"
        raise ImageError(f"{path}: no such file; {remedy}") from None
    except IsADirectoryError:
        raise ImageError(f"{path}: is a folder; name a photograph in it") from None
    except OSError as error:
        reason = error.strerror
        raise ImageError(f"{path}: cannot be read ({reason}); check the path and its permissions") from None


def _near(path: Path) -> Path | None:
    """Return what a folder has by nearly this name, or but for its case; numbers must be the same."""
    with suppress(OSError):
        names = _names_by_digits(path.parent).get(_digits(path.name), {})
        if len(names) <= MOST_LIKE_IT and (near := get_close_matches(path.name.lower(), names, 1, 0.85)):
            return path.with_name(names[near[0]])
    return None


@lru_cache(maxsize=1)
def _names_by_digits(folder: Path) -> dict[str, dict[str, str]]:
    """Return the names of a folder by their digits and their lower case; it is read once."""
    names: dict[str, dict[str, str]] = {}
    for name in os.listdir(folder):
        names.setdefault(_digits(name), {})[name.lower()] = name
    return names


def _digits(name: str) -> str:
    return re.sub(r"\D", "", name)
