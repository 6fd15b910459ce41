"""Where the time of one estimate goes, beside the classical alternative; streams, whole processes, triage.

    python -m tools.evaluation.benchmark --out tools/results/benchmark.md

renders one 1280x720 scene and times every step of an estimate of the blurred photograph, and SIFT, matching
and pycolmap's F on the two SHARP ends of the same exposure; frames of a stream; whole processes, of 1280x720
and of 24 megapixels, blurred and sharp; and ``blur2view triage`` of videos by one process. Speeds of machines
differ: read the ratios.
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
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np

import blur2view
from blur2view.arrays import AnyArray
from tools.arguments import Target, run
from tools.datasets.testset import test_options, write_scene
from tools.pages import publish, table

SIZE, LARGE = (1280, 720), (6000, 4000)
SCENE = 3  # index in the test split of the scene that is timed
ROOT = Path(__file__).resolve().parents[2]
STREAMS, VIDEOS = ((640, 480), SIZE), (SIZE, (1920, 1080))
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
    sharp = [np.asarray(cv2.imread(str(end), cv2.IMREAD_GRAYSCALE)) for end in ends]
    steps: dict[str, Callable[[], Any]] = {
        "decode": lambda: blur2view.read_image(photo),
        "network": lambda: network.predict(image),
        "matches": lambda: blur2view.select_matches(found.grid),
        "F": lambda: blur2view.estimate_two_view(found.matches, rng=0),
        "decode to F": lambda: blur2view.estimate(blur2view.read_image(photo), network=network),
        "motion mask": lambda: blur2view.segment(found, image),
        "classical: two sharp frames": lambda: classical(*sharp),
    }
    seconds = {name: timed(work, repeats) for name, work in steps.items()}
    rival = list(seconds.values())[-1]
    return [(name, f"{s:.3f}", f"{s / rival:.2f}") for name, s in seconds.items()]


def stream_rows(picture: AnyArray) -> Iterator[tuple[str, str]]:
    """Yield the milliseconds of a processor for a frame and its rate, of a picture that moves to the left."""
    for size in STREAMS:
        count = FRAMES + WARM
        wide = cv2.resize(picture, (size[0] + DRIFT_PX * count, size[1]), interpolation=cv2.INTER_AREA)
        frames = (np.ascontiguousarray(wide[:, DRIFT_PX * k :][:, : size[0]]) for k in range(count))
        network, camera = blur2view.SmearNetwork(threads=1), blur2view.Camera.from_focal(0.9 * size[0], size)
        found = blur2view.estimate_frames(frames, ordered=False, network=network, camera=camera)
        ends = [time.process_time()]
        for frame in found:
            frame.angular_velocity(0.02)
            ends.append(time.process_time())
        yield f"{size[0]}x{size[1]}", f"{1000 * np.median(np.diff(ends)[WARM:]):.0f}"


def measured(arguments: list[str | Path], repeats: int) -> AnyArray:
    """Return wall seconds, seconds of processors and the peak of memory, MiB, of a command: medians (3,)."""
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
        wall_s, cpu_s, mib = measured(["estimate", path, "-o", folder / "out"], repeats)
        first = first or wall_s
        yield name, f"{wall_s:.2f}", f"{cpu_s:.2f}", f"{mib:.0f}", f"{wall_s / first:.2f}"
    for size in VIDEOS:
        path, both = folder / f"{size[0]}x{size[1]}.avi", [cv2.resize(one, size) for one in (blurred, sharp)]
        video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30, size)
        for k in range(FRAMES):
            video.write(np.roll(both[k % 2], 8 * k, axis=1))
        video.release()
        wall_s, cpu_s, mib = measured(["triage", path, "--jobs", "1"], repeats)
        rate = f"{FRAMES / wall_s:.1f} frames a second"
        yield f"triage of a video, {path.stem}", f"{wall_s:.2f}", f"{cpu_s:.2f}", f"{mib:.0f}", rate


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
    publish(
        out,
        f"{machine()}; medians of {repeats} runs, of whole processes fewer.",
        table("step, 1280x720, warm | seconds | over the classical alternative", steps),
        table("stream, one thread, not ordered in time | processor, ms a frame", streams),
        table("process | seconds | of processors | MiB | over the first, or rate", processes),
    )


if __name__ == "__main__":
    run(main)
