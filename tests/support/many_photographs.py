"""Small photographs for the tiny network, videos of them, and the program in a process of its own."""

import os
import signal
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from subprocess import PIPE, Popen

import cv2
import numpy as np
from PIL import ExifTags, Image

from blur2view.arrays import AnyArray
from tests.support.colour_code import colour_code, write_picture

ROOT = Path(__file__).resolve().parents[2]
SAMPLE = ROOT / "models/sample.jpg"


def write_photographs(folder: Path, count: int, shape: tuple[int, int] = (64, 80)) -> list[Path]:
    """Return small pictures that differ: in each the tiny network sees another motion."""
    folder.mkdir(parents=True, exist_ok=True)
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    motion = np.dstack([x - 30.0, y - 20.0])
    return [
        write_picture(folder / f"{index:03d}.png", colour_code((0.2 + index / 50) * motion, 1.0))
        for index in range(count)
    ]


def write_video(path: Path, count: int, shape: tuple[int, int] = (64, 80)) -> Path:
    """Return a video of frames that grow lighter, ten a second."""
    return write_frames(path, [np.full((*shape, 3), 20 + 2 * index, np.uint8) for index in range(count)])


def write_frames(path: Path, frames: Sequence[AnyArray], codec: str = "mp4v", rate: float = 10) -> Path:
    """Return a video of these frames (H, W, 3), BGR, ``rate`` a second."""
    size = frames[0].shape[1], frames[0].shape[0]
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), rate, size)
    for frame in frames:
        video.write(frame)
    video.release()
    return path


def command(*words: object) -> list[str]:
    """Return the command that runs the program."""
    return [sys.executable, "-m", "blur2view", *map(str, words)]


HELD = """
import sys, time
from pathlib import Path
from blur2view import output
from blur2view.__main__ import program
from blur2view.cli import terminal
from blur2view.cli.batch import executors

write, free, gate, end = output.write_files, iter(range(8)), Path(sys.argv.pop(1)), time.monotonic() + 600

def held(*given, **how):
    if next(free, None) is None:
        while not gate.exists() and time.monotonic() < end:
            time.sleep(0.01)
    write(*given, **how)

output.write_files, terminal.LINE_S = held, 3600  # and no line says how far it is
executors.CONNECT_S, executors.WORKERS_S = 60, 300  # a scheduler that was killed is sought as long
sys.exit(program())
"""


def start(*words: object, gate: Path | None = None) -> Popen[str]:
    """Start the program from this checkout, so that it takes Ctrl-C, which jobs in the background ignore.

    With ``gate`` it writes the results of 8 photographs, and of more once that file is there: so it has not
    ended before a test ends it, however slow that is. It also waits longer for a Dask cluster.
    """
    line = command(*words) if gate is None else [sys.executable, "-c", HELD, str(gate), *map(str, words)]
    heeds = None if sys.platform == "win32" else partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    return Popen(line, env=environment(), stdout=PIPE, stderr=PIPE, text=True, preexec_fn=heeds)


def environment() -> dict[str, str]:
    """Return the environment in which this checkout is imported and libraries use one thread."""
    return os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}


def contents(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder by their names."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def exif_of(*, orientation: int = 1, **tags: float) -> Image.Exif:
    """Return EXIF of these tags; Pillow writes none into a PNG that has no orientation."""
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    exif.get_ifd(ExifTags.IFD.Exif).update({ExifTags.Base[name].value: value for name, value in tags.items()})
    return exif
