"""Command lines of tools: help, and paths, looked at before any work, so that a wrong one costs one line."""

from __future__ import annotations

import argparse
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
