"""Where the time of one estimate goes, beside the classical alternative, and that of whole processes.

``python -m tools.evaluation.benchmark --out tools/results/benchmark.md`` renders one 1280x720 scene and times
every step of an estimate of the blurred photograph, and SIFT, matching and pycolmap's F on the two SHARP ends
of the same exposure; a whole process; and ``blur2view triage`` of videos of three sizes by one process,
beside decoding them, FFmpeg's blurdetect and the Laplacian. Speeds of machines differ: read the ratios.
"""

import compileall
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from shutil import which
from statistics import median
from typing import Any

import cv2
import numpy as np
import pycolmap

import blur2view
from blur2view.arrays import AnyArray
from blur2view.movers.moving import moving_in
from blur2view.networks.model_file import one_thread
from blur2view.networks.smear_network import Detail
from tools.command import Target, publish, run, table
from tools.datasets.testset import write_scene
from tools.rendering.render import RenderOptions

SIZE = (1280, 720)
SCENE = 3  # index in the test split of the scene that is timed
VIDEOS = {(640, 480): 120, (1920, 1080): 60, (3840, 2160): 24}  # frames of videos by their size
ROOT = Path(__file__).resolve().parents[2]
BLUR2VIEW = [sys.executable, "-m", "blur2view"]


def timed(work: Callable[[], Any], repeats: int, clock: Callable[[], float] = time.perf_counter) -> float:
    """Return the median seconds of a call, after one that is not counted."""
    seconds = []
    for _ in range(repeats + 1):
        start = clock()
        work()
        seconds.append(clock() - start)
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
    """Yield the row of a whole process: seconds."""
    photo = folder / "a.jpg"
    cv2.imwrite(str(photo), blurred)
    command = [*BLUR2VIEW, "estimate", str(photo), "-o", str(folder)]
    work = partial(subprocess.run, command, stdout=subprocess.DEVNULL, cwd=ROOT, check=True)
    yield "1280x720", f"{timed(work, repeats):.2f}"


def naming_rows(video: Path, repeats: int) -> Iterator[tuple[str, ...]]:
    """Yield rows of what `triage` does to the first two frames of a video, a sharp and a blurred one, warm.

    Processor seconds by one thread.
    """
    network, capture = blur2view.SmearNetwork(threads=1), cv2.VideoCapture(str(video))
    sharp, blurred = (cv2.cvtColor(capture.read()[1], cv2.COLOR_BGR2RGB) for _ in range(2))
    grid, rng = network.predict(sharp), np.random.default_rng(0)
    name = partial(blur2view.estimate, network=network, detail=Detail.RANKING, geometry=False)
    steps: dict[str, Callable[[], Any]] = {
        "first look": lambda: network.predict(sharp, detail=Detail.RANKING),
        "all windows": lambda: network.predict(sharp),
        "what moves by itself": lambda: moving_in(sharp, grid, rng, network.execution),
        "a blurred frame": lambda: name(blurred),
        "a sharp frame": lambda: name(sharp),
    }
    for step, work in steps.items():
        with one_thread:  # as within `estimate`
            seconds = timed(work, repeats, time.process_time)
        yield step, f"{seconds:.3f}"


def video_rows(folder: Path, blurred: AnyArray, sharp: AnyArray) -> Iterator[tuple[str, ...]]:
    """Yield rows of ways to look at the frames of a video: processor seconds a frame, over decoding's."""
    ways: dict[str, list[str]] = {}
    for size, count in VIDEOS.items():
        video, every = folder / f"{size[0]}.mp4", [cv2.resize(one, size) for one in (blurred, sharp)]
        writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"mp4v"), 30, size)
        for k in range(count):
            writer.write(np.roll(every[k % 3 == 0], 8 * k, axis=1))
        writer.release()
        seconds = {
            "decoding by OpenCV": decoded(video, lambda frame: None),
            "variance of the Laplacian": decoded(video, laplacian),
        }
        if which("ffmpeg"):
            words = ["ffmpeg", "-v", "error", "-i", str(video)]
            seconds["decoding by FFmpeg"] = processor_s([*words, "-f", "null", "-"])
            seconds["FFmpeg's blurdetect"] = processor_s([*words, "-vf", "blurdetect", "-f", "null", "-"])
        triage, keep = [*BLUR2VIEW, "triage", str(video), "--jobs", "1"], str(folder / f"{size[0]}.txt")
        seconds["`triage --every-best 10`"] = processor_s([*triage, "--every-best", "10", "--keep", keep])
        seconds["`triage`"] = processor_s(triage)
        for way, whole in seconds.items():
            share = whole / seconds["decoding by OpenCV"]
            ways.setdefault(way, []).append(f"{whole / count:.3f} ({share:.1f})")
    yield from ((way, *cells) for way, cells in ways.items())


def decoded(video: Path, look: Callable[[AnyArray], Any]) -> float:
    """Return the processor seconds of looking at every frame of a video."""
    start, capture = time.process_time(), cv2.VideoCapture(str(video))
    while (read := capture.read())[0]:
        look(read[1])
    return time.process_time() - start


def laplacian(frame: AnyArray) -> float:
    """Return the variance of the Laplacian of a frame (H, W, 3), by which people choose frames."""
    return float(cv2.Laplacian(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), cv2.CV_64F).var())


def processor_s(command: list[str]) -> float:
    """Return the processor seconds of a whole process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, stdout=subprocess.DEVNULL, cwd=ROOT, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


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
        blurred, sharp = (np.asarray(cv2.imread(str(path))) for path in (photo, ends[0]))
        processes = list(process_rows(folder, blurred, max(3, repeats // 3)))
        videos = list(video_rows(folder, blurred, sharp))
        naming = list(naming_rows(folder / "640.mp4", repeats))
    publish(
        out,
        f"{machine()}; medians of {repeats} runs, of whole processes fewer.",
        table("step, 1280x720, warm | seconds | over the classical alternative", steps),
        table("`estimate`, whole process | seconds", processes),
        "Processor seconds a frame of whole processes, start included; in brackets over decoding by OpenCV. "
        f"Videos of {', '.join(map(str, VIDEOS.values()))} frames, a third of them sharp.",
        table(f"way | {' | '.join(f'{width}x{height}' for width, height in VIDEOS)}", videos),
        table("what `triage` does to a frame, 640x480, warm, one thread | processor seconds", naming),
    )


if __name__ == "__main__":
    run(main)
