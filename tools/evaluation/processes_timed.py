"""Whole ``blur2view`` processes timed from outside, of this source tree and of an earlier commit, in turn."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import cv2
import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
LARGE = {"12 megapixels": (4000, 3000), "24 megapixels": (6000, 4000)}
VIDEOS = {"1280x720": (1280, 720), "1920x1080": (1920, 1080)}
FRAMES = 24
STEPS = {
    "Python": "",
    "Python and NumPy": "import numpy",
    "imports of the command": "import blur2view.cli.outputs",
    "the network, loaded": "import blur2view.cli.outputs; blur2view.SmearNetwork()",
}
"""What a process does before it reads a photograph; each has those before it."""
LAUNCHER = """
import json, os, subprocess, sys, time
start = time.perf_counter()
process = subprocess.Popen([sys.executable, *sys.argv[1:]], stdout=subprocess.DEVNULL)
_, status, used = os.wait4(process.pid, 0)
took = time.perf_counter() - start, used.ru_utime + used.ru_stime, used.ru_maxrss
process.returncode = os.waitstatus_to_exitcode(status)
print(json.dumps([process.returncode, *took]))
"""
"""Runs a process from a small one: the peak of a process's memory begins with that of what starts it."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """What one process took: wall seconds, seconds of the processor, and the peak of its memory (MiB)."""

    wall_s: float
    cpu_s: float
    memory_mib: float


def measured(root: Path, arguments: Sequence[str | Path]) -> Run:
    """Return what a Python process took that imports this package from a source tree."""
    environment = os.environ | {"PYTHONPATH": str(root)}
    words = [sys.executable, "-c", LAUNCHER, *map(str, arguments)]
    done = subprocess.run(words, stdout=subprocess.PIPE, env=environment, cwd=root, check=True)
    code, wall_s, cpu_s, memory = json.loads(done.stdout)
    if code:
        raise SystemExit(f"{root}: {' '.join(map(str, arguments))} ends with {code}")
    scale = 1 if sys.platform == "darwin" else 1024
    return Run(wall_s=wall_s, cpu_s=cpu_s, memory_mib=memory * scale / 2**20)


def in_turn(roots: Sequence[Path], arguments: Sequence[str | Path], repeats: int) -> list[Run]:
    """Return the medians of each tree's runs; the trees take turns, so that both see the same machine."""
    runs: list[list[Run]] = [[] for _ in roots]
    for _ in range(repeats):
        for root, own in zip(roots, runs, strict=True):
            own.append(measured(root, arguments))
    return [
        Run(**{name: median(getattr(run, name) for run in own) for name in ("wall_s", "cpu_s", "memory_mib")})
        for own in runs
    ]


def checkout(commit: str, folder: Path) -> Path:
    """Return a source tree of an earlier commit, made in a folder; SystemExit if there is none."""
    made = subprocess.run(["git", "-C", ROOT, "archive", commit], capture_output=True, check=False)
    if made.returncode:
        raise SystemExit(f"{commit}: is no commit of {ROOT}")
    folder.mkdir()
    subprocess.run(["tar", "-x", "-C", folder], input=made.stdout, check=True)
    return folder


def write_large(folder: Path, blurred: Path, sharp: Path) -> dict[str, Path]:
    """Write and return large photographs by name: a blurred one enlarged, a sharp one repeated, mirrored."""
    pictures = {}
    for name, size in LARGE.items():
        larger = cv2.resize(_read(blurred), size, interpolation=cv2.INTER_CUBIC)
        small = _read(sharp)
        below, right = size[1] - small.shape[0], size[0] - small.shape[1]
        repeated = np.pad(small, ((0, below), (0, right), (0, 0)), mode="reflect")
        for kind, picture in (("blurred", larger), ("sharp", repeated)):
            path = folder / f"{name} {kind}.jpg".replace(" ", "_")
            cv2.imwrite(str(path), picture)
            pictures[f"{name}, {kind}"] = path
    return pictures


def write_video(path: Path, blurred: Path, sharp: Path, size: tuple[int, int]) -> Path:
    """Write and return a video whose frames are a blurred and a sharp photograph, in turn, that move on."""
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, size)
    pictures = [cv2.resize(_read(one), size, interpolation=cv2.INTER_AREA) for one in (blurred, sharp)]
    for k in range(FRAMES):
        video.write(np.roll(pictures[k % len(pictures)], 8 * k, axis=1))
    video.release()
    return path


def _read(path: Path) -> NDArray[np.uint8]:
    return np.asarray(cv2.imread(str(path)), np.uint8)
