"""Lists of photographs and videos that are not what they should be, drawn from a generator."""

import os
import struct
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from tools.robustness.damage import Rng, cut, flipped
from tools.robustness.hostile_files import blurred

BOXES = (b"stsz", b"stts", b"mdhd", b"mvhd", b"stsc", b"tkhd", b"stco", b"trak", b"avih", b"strh")
OPTIONS = (
    ["--every", "4"], ["--every", "4"], ["--every", "5"], ["--from", "0.3s"], ["--to", "2"],
    ["--from", "9", "--every", "2"], ["--to", "9s"],
)  # fmt: skip
LINES = (
    "", "   ", "# a comment", "  #", ".", "..", "/", "~", "-", "--", "--overwrite", "@", "@.", "\x1b[2J", "ü",
    "a" * 300, "b" * 5000, "x/" * 3000, "absent.jpg", "/dev/zero", "/dev/null", "/proc/self/mem", "*.jpg",
    "good.jpg/000000", "good.jpg", "./good.jpg", "clip.mp4/000001", "\u202e.jpg", "\ufeff", "\x85", "\x0c",
)  # fmt: skip
FRAMES, SIZE = 12, (96, 72)
NUMBERS = (0, 1, 2, 255, 2**16, 2**31 - 1, 2**31, 2**32 - 1)


def hostile_list(folder: Path, rng: Rng, number: int, others: Sequence[Path]) -> list[str]:
    """Make a hostile list and return the words that name it; ``others`` are photographs that it may name."""
    path = folder / f"list{number}.txt"
    kinds = ("names", "names", "names", "zeros", "bytes", "itself", "place")
    kind = kinds[number % len(kinds)]
    if kind == "place":
        places = (folder, Path("/dev/zero"), Path("/dev/null"), folder / "absent.txt", folder / "fifo.txt")
        path = places[int(rng.integers(len(places)))]
        if path.name == "fifo.txt" and not path.exists():
            os.mkfifo(path)
        return [f"@{path}"]
    photographs = [str(path) for path in others]
    names = [*rng.choice(LINES, int(rng.integers(0, 12))), *rng.permutation(photographs)[:3]]
    lines = [os.fsencode(str(name)) for name in rng.permutation(np.array(names, object))]
    if kind == "itself":
        lines += [os.fsencode(f"@{path}"), os.fsencode(path), b"-"]
    if kind == "bytes":
        lines += [rng.bytes(int(rng.integers(1, 200))) for _ in range(3)]
    separator = b"\0" if kind == "zeros" else [b"\n", b"\r\n", b"\r"][int(rng.integers(3))]
    path.write_bytes(separator.join(lines))
    return [f"@{path}"] if rng.random() < 0.9 else [str(path)]


def hostile_video(folder: Path, rng: Rng, number: int) -> list[str]:
    """Make a hostile video and return words that name it, its frames, or frames that it has not."""
    path = folder / f"{number}{rng.choice(['.mp4', '.avi', '.mkv', '.MOV'])}"
    data = _video(folder, rng)
    match number % 6:
        case 0:
            data = cut(data, rng)
        case 1:
            data = flipped(data, rng, 40)
        case 2:  # sizes, counts and rates of the boxes
            found = [at for name in BOXES if (at := data.find(name)) > 0]
            for _ in range(3):
                at = int(rng.choice(found)) + 4 * int(rng.integers(-1, 7))
                word = struct.pack("><"[int(rng.integers(2))] + "I", int(rng.choice(NUMBERS)))
                data = data[:at] + word + data[at + 4 :]
        case 3:
            data = rng.bytes(int(rng.integers(0, 3000)))
        case 4:
            data += rng.bytes(1000)
    path.write_bytes(data)
    frames = [f"{path}/{frame}" for frame in ("000000", "000003", "000999", "9" * 30, "-1", "x", "٣")]
    named = [str(path), *rng.choice(frames, int(rng.integers(0, 3)), replace=False)]
    return [*OPTIONS[int(rng.integers(len(OPTIONS)))], "--", *named]


def _video(folder: Path, rng: Rng) -> bytes:
    """Return a short video of noise that is smeared sideways."""
    suffix, codec = (".mp4", "mp4v") if rng.random() < 0.6 else (".avi", "MJPG")
    path = folder / f"whole{suffix}"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), 10, SIZE)
    for _ in range(FRAMES):
        video.write(np.asarray(blurred(rng, SIZE))[..., ::-1])
    video.release()
    content = path.read_bytes()
    path.unlink()
    return content
