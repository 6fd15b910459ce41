"""Command lines of tools: help, and paths, looked at before any work, so that a wrong one costs one line."""

import argparse
import multiprocessing
from pathlib import Path


def existing(text: str) -> Path:
    """Return the path of a file or folder that is there; anything else is wrong usage."""
    path = Path(text)
    if not path.exists():
        raise argparse.ArgumentTypeError(f"{text}: no such file or folder")
    return path


def target(text: str) -> Path:
    """Return the path of a result, after making its folder; where none can be made that is wrong usage."""
    path = Path(text)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{text}: {path.parent}: {error.strerror}") from None
    return path


def parser_of(text: str | None) -> argparse.ArgumentParser:
    """Return a parser whose help shows a module's docstring as it stands."""
    return argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)


def scene_parser(text: str | None, scenes: int, size: tuple[int, int]) -> argparse.ArgumentParser:
    """Return a parser of a tool that renders so many scenes of a size into a folder."""
    parser = parser_of(text)
    parser.add_argument("out", type=Path, help="folder to write")
    parser.add_argument("--scenes", type=int, default=scenes, help="(default: %(default)s)")
    parser.add_argument("--photos", type=existing, help="folder of further photographs used as textures")
    parser.add_argument("--size", type=int, nargs=2, default=size, metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--jobs", type=int, default=multiprocessing.cpu_count(), help="processes")
    return parser
