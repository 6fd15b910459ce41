"""Runs over many photographs: how fast and how large they are, and what kills leave of them.

    python -m tools.evaluation.many_photographs rate --count 1000
    python -m tools.evaluation.many_photographs kills --trials 50

``rate`` estimates photographs (pieces of models/sample.jpg) with one process and with several, and prints
the rates and their ratio, and the memory of all processes over the first and the last hundred photographs.
``kills`` kills runs with SIGKILL at random moments, goes on with --resume, and compares the outputs with
those of an undisturbed run; a photograph of the manifest is never done twice.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
SAMPLE = ROOT / "models/sample.jpg"
MANIFEST = "estimate.manifest.jsonl"
WARM = 20  # photographs until every process has loaded its network
EVERY_S = 0.2


def write_photographs(folder: Path, count: int, size: tuple[int, int], seed: int = 0) -> Path:
    """Return a folder of pieces of the sample, scaled to a size (width, height) and mirrored at random."""
    folder.mkdir(parents=True)
    sample = cv2.imread(str(SAMPLE))
    if sample is None:
        raise FileNotFoundError(SAMPLE)
    rng = np.random.default_rng(seed)
    for index in range(count):
        share = rng.uniform(0.6, 1.0)
        height, width = (round(side * share) for side in sample.shape[:2])
        y, x = (
            rng.integers(0, full - part + 1)
            for full, part in zip(sample.shape, (height, width), strict=False)
        )
        piece = cv2.resize(sample[y : y + height, x : x + width], size, interpolation=cv2.INTER_AREA)
        piece = cv2.flip(piece, int(rng.integers(-1, 2)))
        cv2.imwrite(str(folder / f"{index:04d}.jpg"), piece, [cv2.IMWRITE_JPEG_QUALITY, 95])
    return folder


def start(*words: object) -> subprocess.Popen[bytes]:
    """Start ``blur2view estimate`` from this checkout."""
    command = [sys.executable, "-m", "blur2view", "estimate", *map(str, words)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)


def done_lines(out: Path) -> int:
    """Return how many photographs a manifest says are done."""
    manifest = out / MANIFEST
    return manifest.read_bytes().count(b'"outputs"') if manifest.exists() else 0


def memory_mib(process: int) -> float:
    """Return the memory of a process and its children, without counting twice what they share."""
    try:
        children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
        lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()
    except OSError:  # it has ended
        return 0.0
    own = sum(int(line.split()[1]) for line in lines if line.startswith("Pss:")) / 1024
    return own + sum(memory_mib(int(child)) for child in children)


@dataclass(frozen=True, kw_only=True)
class Course:
    """A run: photographs a second between the first WARM and the last, and memory by photographs done."""

    rate: float
    memory: list[tuple[int, float]]

    def mean_mib(self, first: int, last: int) -> float:
        """Return the mean memory while between so many photographs were done."""
        return float(np.mean([mib for done, mib in self.memory if first <= done <= last] or [np.nan]))


def follow(photographs: Path, out: Path, words: Sequence[object]) -> Course:
    """Return the course of a run."""
    running = start(photographs, "-o", out, "-q", *words)
    memory: list[tuple[int, float]] = []
    begun = None
    while running.poll() is None:
        done = done_lines(out)
        memory.append((done, memory_mib(running.pid)))
        if begun is None and done >= WARM:
            begun = (time.monotonic(), done)
        time.sleep(EVERY_S)
    if running.returncode or begun is None:
        raise SystemExit("the run failed, or had too few photographs")
    return Course(rate=(done_lines(out) - begun[1]) / (time.monotonic() - begun[0]), memory=memory)


def measure_rate(options: argparse.Namespace, folder: Path) -> int:
    """Print rates and memory; return the exit code."""
    photographs = write_photographs(folder / "in", options.count, options.size)
    courses = []
    for run, jobs in (("one", 1), ("several", options.jobs)):
        table = ["--csv", folder / f"{run}.csv"] if options.csv else []
        courses.append(follow(photographs, folder / run, ["--jobs", jobs, *table]))
    one, several = courses
    first, last = (WARM, min(100, options.count)), (max(options.count - 100, WARM), options.count - 1)
    early, late = several.mean_mib(*first), several.mean_mib(*last)
    width, height = options.size
    print(f"{options.count} photographs of {width}x{height}: one process {one.rate:.2f} a second, "
          f"{options.jobs} processes {several.rate:.2f}, {several.rate / one.rate:.2f} times")  # fmt: skip
    print(f"memory {early:.0f} MiB over photographs {first[0]} to {first[1]}, "
          f"{late:.0f} MiB over {last[0]} to {last[1]}: {late / early - 1:+.1%}")  # fmt: skip
    return 0


def contents(out: Path) -> dict[str, bytes]:
    """Return the results of a folder by their names."""
    return {path.name: path.read_bytes() for path in out.iterdir() if path.name != MANIFEST}


def kill_runs(options: argparse.Namespace, folder: Path) -> int:
    """Print what became of runs that were killed; return 1 if any output differs or was done twice."""
    photographs = write_photographs(folder / "in", options.count, options.size)
    words = [photographs, "-q", "--no-timings", "--jobs", options.jobs]
    begun = time.monotonic()
    start(*words, "-o", folder / "whole").wait()
    whole_s, expected = time.monotonic() - begun, contents(folder / "whole")
    moments = random.Random(options.seed)
    wrong = twice = 0
    in_hand = []
    for trial in range(options.trials):
        out = folder / f"out{trial}"
        running = start(*words, "-o", out)
        time.sleep(moments.uniform(0, whole_s))
        running.send_signal(signal.SIGKILL)
        running.wait()
        time.sleep(1)  # processes that it left write what they have, and end
        before = done_lines(out)
        written = len(list(out.glob("[0-9]*.json"))) if out.exists() else 0
        in_hand.append(written - before)
        code = start(*words, "-o", out, "--resume").wait()
        wrong += code != 0 or contents(out) != expected
        twice += done_lines(out) != options.count
    print(f"{options.trials} kills of a run of {options.count} photographs with {options.jobs} processes: "
          f"{wrong} outputs differ, {twice} runs did a photograph of the manifest again; "
          f"written but not in the manifest, and so done again: at most {max(in_hand)}")  # fmt: skip
    return int(wrong + twice > 0)


def main() -> int:
    """Return the exit code, after one of both measurements."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    kinds = parser.add_subparsers(required=True)
    for name, run, count, size in (
        ("rate", measure_rate, 1000, "640x480"),
        ("kills", kill_runs, 60, "160x120"),
    ):
        kind = kinds.add_parser(name)
        kind.set_defaults(run=run)
        kind.add_argument("--count", type=int, default=count, help="photographs (default: %(default)s)")
        kind.add_argument("--size", default=size, type=_size, help="of a photograph (default: %(default)s)")
        kind.add_argument("--jobs", type=int, default=2, help="processes (default: %(default)s)")
    kinds.choices["rate"].add_argument("--csv", action="store_true", help="write a table, too")
    kinds.choices["kills"].add_argument("--trials", type=int, default=50)
    kinds.choices["kills"].add_argument("--seed", type=int, default=0, help="of the moments")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        return int(options.run(options, Path(folder)))


def _size(text: str) -> tuple[int, int]:
    """Return width and height."""
    width, _, height = text.partition("x")
    return int(width), int(height)


if __name__ == "__main__":
    sys.exit(main())
