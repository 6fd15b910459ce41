"""Programs of the names that libraries are known to call, which leave a mark if one does."""

import os
import sys
from pathlib import Path

PROGRAMS = (
    "gs", "gswin64c", "djpeg", "xv", "convert", "magick", "identify", "ffmpeg", "ffprobe", "dcraw",
    "exiftool", "colmap", "sh", "bash",
)  # fmt: skip
"""What libraries for pictures, videos and models are known to call, and shells."""


def set_traps(folder: Path) -> Path:
    """Write these programs into a new folder; return the file that each writes its name to."""
    mark = folder.with_name(f"{folder.name}-ran")
    folder.mkdir()
    for name in PROGRAMS:
        program = folder / name
        program.write_text(f"#!{sys.executable}\nopen({str(mark)!r}, 'a').write('{name}\\n')\n")
        program.chmod(0o755)
    return mark


def trapped_path(folder: Path) -> str:
    """Return PATH with the traps before all other programs."""
    return f"{folder}{os.pathsep}{os.environ['PATH']}"


def trapped(folder: Path) -> tuple[str, ...]:
    """Return the programs that were started since this was last asked."""
    mark = folder.with_name(f"{folder.name}-ran")
    if not mark.exists():
        return ()
    names = tuple(mark.read_text().split())
    mark.unlink()
    return names
