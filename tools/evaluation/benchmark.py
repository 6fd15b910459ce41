"""Where the time of one estimate goes, beside the classical alternative, and that of whole processes.

``python -m tools.evaluation.benchmark --out tools/results/benchmark.md`` renders one 1280x720 scene and times
every step of an estimate of the blurred photograph, and SIFT, matching and pycolmap's F on the two SHARP ends
of the same exposure; a whole process; and ``blur2view triage`` of a video by one process. Speeds of machines
differ: read the ratios.
"""

import compileall
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np
import pycolmap

import blur2view
from blur2view.arrays import AnyArray
from tools.command import Target, publish, run, table
from tools.datasets.testset import write_scene
from tools.rendering.render import RenderOptions

SIZE = (1280, 720)
SCENE, FRAMES = 3, 20  # index in the test split of the scene that is timed; frames of the video
ROOT = Path(__file__).resolve().parents[2]


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
        "F": lambda: blur2view.estimate_two_view(found.matches, rng=0),
        "decode to F": lambda: blur2view.estimate(blur2view.read_image(photo), network=network),
        "motion mask": lambda: blur2view.segment(found, image),
        "classical: two sharp frames": lambda: classical(*sharp),
    }
    seconds = {name: timed(work, repeats) for name, work in steps.items()}
    rival = list(seconds.values())[-1]
    return [(name, f"{s:.3f}", f"{s / rival:.2f}") for name, s in seconds.items()]


def process_rows(folder: Path, blurred: AnyArray, repeats: int) -> Iterator[tuple[str, ...]]:
    """Yield rows of whole processes: seconds, and frames a second of a video."""
    photo, video = folder / "a.jpg", folder / "a.avi"
    cv2.imwrite(str(photo), blurred)
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"MJPG"), 30, SIZE)
    for k in range(FRAMES):
        writer.write(np.roll(blurred, 8 * k, axis=1))
    writer.release()

    def seconds(*words: object) -> float:
        command = [sys.executable, "-m", "blur2view", *map(str, words)]
        work = partial(subprocess.run, command, stdout=subprocess.DEVNULL, cwd=ROOT, check=True)
        return timed(work, repeats)

    yield "1280x720", f"{seconds('estimate', photo, '-o', folder):.2f}", ""
    triage_s = seconds("triage", video, "--jobs", 1)
    yield "triage of a video", f"{triage_s:.2f}", f"{FRAMES / triage_s:.1f} frames a second"


def machine() -> str:
    """Return the name of the processor and the number of cores that this process may use."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor()}, {len(os.sched_getaffinity(0))} cores"


def main(*, repeats: int = 9, out: Target | None = None) -> None:
    """Measure every step ``repeats`` times, whole processes a third of that, and write the page."""
    compileall.compile_dir(ROOT / "blur2view", quiet=1)  # as pip does
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_scene(("", SCENE), folder, RenderOptions(size=SIZE, smear_px=(15.0, 20.0)))
        photo, *ends = (folder / f"{SCENE:04d}{end}.png" for end in ("", "_open", "_close"))
        steps = step_rows(photo, ends, repeats)
        processes = list(process_rows(folder, np.asarray(cv2.imread(str(photo))), max(3, repeats // 3)))
    publish(
        out,
        f"{machine()}; medians of {repeats} runs, of whole processes fewer.",
        table("step, 1280x720, warm | seconds | over the classical alternative", steps),
        table("process | seconds | rate", processes),
    )


if __name__ == "__main__":
    run(main)
