"""Where the time of one estimate goes, beside the classical alternative; streams, whole processes, triage.

    python -m tools.evaluation.benchmark --out tools/results/benchmark.md

renders one 1280x720 scene and times every step of an estimate of the blurred photograph, and SIFT, matching
and pycolmap's F on the two SHARP ends of the same exposure; frames of a stream of 640x480 and 1280x720, by 1
and 4 threads, with the order in time (one frame late) and without; whole processes, of 1280x720 and of 24
megapixels, blurred and sharp; and ``blur2view triage`` of videos by one process. Speeds of machines differ:
read the ratios.
"""

import compileall
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import blur2view
from blur2view.arrays import AnyArray
from tools.arguments import Target, run
from tools.datasets.testset import test_options, write_scene
from tools.pages import joined, publish, table

SIZE, LARGE = (1280, 720), (6000, 4000)
SCENE = 3  # index in the test split of the scene that is timed
ROOT = Path(__file__).resolve().parents[2]
STREAMS, THREADS, VIDEOS = ((640, 480), SIZE), (1, 4), (SIZE, (1920, 1080))
FRAMES, WARM, DRIFT_PX = 20, 2, 3  # of a stream; frames that are not counted; from frame to frame
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

Taken = NDArray[np.float64]
"""What a process took (3,): wall seconds, seconds of the processor, and the peak of its memory (MiB)."""


def timed(work: Callable[[], Any], repeats: int) -> float:
    """Return the median seconds of a call, after one that is not counted."""
    seconds = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return median(seconds[1:])


def classical(first: AnyArray, last: AnyArray) -> None:
    """Match SIFT features of two sharp photographs (H, W), uint8, and estimate F, as people do today."""
    import pycolmap

    sift = cv2.SIFT.create(4000)
    (keys1, words1), (keys2, words2) = (sift.detectAndCompute(image, None) for image in (first, last))
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(words1, words2, k=2)
    good = [a for a, b in (p for p in pairs if len(p) == 2) if a.distance < 0.8 * b.distance]
    points1 = np.array([keys1[m.queryIdx].pt for m in good])
    points2 = np.array([keys2[m.trainIdx].pt for m in good])
    if len(good) >= 8:
        pycolmap.estimate_fundamental_matrix(points1, points2)


def step_rows(photo: Path, ends: list[Path], repeats: int) -> list[tuple[str, ...]]:
    """Return rows of every step of an estimate, warm: seconds, and over the classical alternative's."""
    network, image = blur2view.SmearNetwork(), blur2view.read_image(photo)
    found = blur2view.estimate(image, network=network)
    steps: dict[str, Callable[[], Any]] = {
        "decode": lambda: blur2view.read_image(photo),
        "network": lambda: network.predict(image),
        "matches": lambda: blur2view.select_matches(found.grid),
        "F": lambda: blur2view.estimate_two_view(found.matches, rng=0),
        "decode to F": lambda: blur2view.estimate(blur2view.read_image(photo), network=network),
        "motion mask": lambda: blur2view.segment(found, image),
        "classical: two sharp frames": lambda: classical(
            *(np.asarray(cv2.imread(str(end), cv2.IMREAD_GRAYSCALE)) for end in ends)
        ),
    }
    seconds = {name: timed(work, repeats) for name, work in steps.items()}
    rival = list(seconds.values())[-1]
    return [(name, f"{s:.3f}", f"{s / rival:.2f}") for name, s in seconds.items()]


def drifting(picture: AnyArray, size: tuple[int, int], count: int) -> Iterator[AnyArray]:
    """Yield frames (H, W, 3) of a photograph that moves to the left."""
    wide = cv2.resize(picture, (size[0] + DRIFT_PX * count, size[1]), interpolation=cv2.INTER_AREA)
    for number in range(count):
        yield np.ascontiguousarray(wide[:, DRIFT_PX * number :][:, : size[0]])


def latencies_ms(picture: AnyArray, size: tuple[int, int], threads: int, ordered: bool) -> AnyArray:
    """Return the milliseconds (FRAMES, 2) of any time and of the processor for a frame and its rate."""
    network = blur2view.SmearNetwork(threads=threads)
    camera = blur2view.Camera.from_focal(0.9 * size[0], size)
    frames = drifting(picture, size, FRAMES + WARM + 1)
    found = blur2view.estimate_frames(frames, ordered=ordered, network=network, camera=camera)
    passed = []
    for _ in range(FRAMES + WARM):
        start = time.perf_counter(), time.process_time()
        next(found).angular_velocity(0.02)
        passed.append((time.perf_counter() - start[0], time.process_time() - start[1]))
    return 1000 * np.array(passed[WARM:])


def stream_rows(picture: AnyArray) -> Iterator[tuple[object, ...]]:
    """Yield rows of streams: size, threads, whether ordered, and milliseconds of a frame."""
    for size, threads, ordered in product(STREAMS, THREADS, (True, False)):
        passed, worked = latencies_ms(picture, size, threads, ordered).T
        figures = (np.median(passed), np.quantile(passed, 0.95), np.median(worked))
        shown = (f"{one:.0f}" for one in figures)
        yield f"{size[0]}x{size[1]}", threads, "yes" if ordered else "no", *shown


def measured(arguments: list[str | Path], repeats: int) -> Taken:
    """Return what a process took that imports this package, the median of some runs."""
    words, taken = [sys.executable, "-c", LAUNCHER, "-m", "blur2view", *map(str, arguments)], []
    for _ in range(repeats):
        done = subprocess.run(words, stdout=subprocess.PIPE, cwd=ROOT, check=True)
        code, wall_s, cpu_s, memory = json.loads(done.stdout)
        if code:
            raise SystemExit(f"{' '.join(map(str, arguments))} ends with {code}")
        taken.append([wall_s, cpu_s, memory / (2**20 if sys.platform == "darwin" else 2**10)])
    return np.asarray(np.median(taken, axis=0))


def process_rows(folder: Path, blurred: AnyArray, sharp: AnyArray, repeats: int) -> Iterator[tuple[str, ...]]:
    """Yield rows of whole processes of photographs and of videos, with their wall over the first one's."""
    below, right = LARGE[1] - sharp.shape[0], LARGE[0] - sharp.shape[1]
    pictures = {
        "1280x720": blurred,
        "24 megapixels, blurred": cv2.resize(blurred, LARGE, interpolation=cv2.INTER_CUBIC),
        "24 megapixels, sharp": np.pad(sharp, ((0, below), (0, right), (0, 0)), mode="reflect"),
    }
    first = 0.0
    for number, (name, picture) in enumerate(pictures.items()):
        cv2.imwrite(str(path := folder / f"{number}.jpg"), picture)
        taken = measured(["estimate", path, "-o", folder / "out"], repeats)
        first = first or float(taken[0])
        yield name, *(f"{one:.2f}" for one in taken[:2]), f"{taken[2]:.0f}", f"{taken[0] / first:.2f}"
    for size in VIDEOS:
        name = f"{size[0]}x{size[1]}"
        video = cv2.VideoWriter(
            str(path := folder / f"{name}.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30, size
        )
        both = [cv2.resize(one, size, interpolation=cv2.INTER_AREA) for one in (blurred, sharp)]
        for k in range(FRAMES):
            video.write(np.roll(both[k % 2], 8 * k, axis=1))
        video.release()
        taken = measured(["triage", path, "--jobs", "1"], repeats)
        rate = f"{FRAMES / taken[0]:.1f} frames a second"
        yield f"triage of a video, {name}", *(f"{one:.2f}" for one in taken[:2]), f"{taken[2]:.0f}", rate


def machine() -> str:
    """Return the name of the processor and the number of cores that this process may use."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor()}, {len(os.sched_getaffinity(0))} cores"


def main(*, repeats: int = 9, out: Target | None = None) -> None:
    """Measure, each figure so many times (whole processes a third of that), and write the page."""
    compileall.compile_dir(ROOT / "blur2view", quiet=1)  # as pip does
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_scene(SCENE, folder, replace(test_options(None, SIZE), detail=1.0, smear_px=(15.0, 20.0)))
        photo, *ends = (folder / f"{SCENE:04d}{end}.png" for end in ("", "_open", "_close"))
        blurred, sharp = (np.asarray(cv2.imread(str(path)), np.uint8) for path in (photo, ends[0]))
        steps = step_rows(photo, ends, repeats)
        streams = list(stream_rows(blur2view.read_image(photo)))
        processes = list(process_rows(folder, blurred, sharp, max(3, repeats // 3)))
    blocks = (
        f"{machine()}; medians of {repeats} runs, of whole processes fewer.",
        table("step, 1280x720, warm | seconds | over the classical alternative", steps),
        table("stream | threads | order in time | median, ms | 95 %, ms | processor, ms", streams),
        table("process | seconds | of processors | MiB | over the first, or rate", processes),
    )
    publish(joined(*blocks), out)


if __name__ == "__main__":
    run(main)
