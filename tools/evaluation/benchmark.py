"""Where the time of one estimate goes, and the classical alternative beside it, in one run.

    python -m tools.evaluation.benchmark --out tools/results/benchmark

renders one 1280x720 scene, measures every step of ``blur2view estimate`` on the blurred photograph, the whole
process from outside, and SIFT + matching + pycolmap's F on the two SHARP ends of the same exposure. Speeds of
machines differ: read the ratios.
"""

import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np

import blur2view
from blur2view.cli.outputs import ESTIMATE, result_contents
from blur2view.output_files import ResultFiles, write_files
from blur2view.pipeline import Run, estimate, estimate_file
from blur2view.results.estimate import EstimateDocument
from blur2view.smears.selection import SelectOptions, select_matches
from blur2view.two_view.estimate import estimate_two_view
from blur2view.two_view.options import EstimatorOptions
from tools.arguments import parser_of, target
from tools.datasets.testset import test_options, write_scene
from tools.pages import publish, table

SIZE = (1280, 720)
LARGE = (6000, 4000)
SCENE = 3  # index in the test split of the scene that is timed


def timed(work: Callable[[], Any], repeats: int) -> float:
    """Return the median seconds of a call, after one that is not counted."""
    seconds = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return median(seconds[1:])


def classical(first: Path, last: Path) -> None:
    """Read two sharp photographs, match SIFT features and estimate F, as people do today."""
    import pycolmap

    sift = cv2.SIFT.create(4000)
    images = [np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8) for path in (first, last)]
    (keys1, words1), (keys2, words2) = (sift.detectAndCompute(image, None) for image in images)
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(words1, words2, k=2)
    good = [a for a, b in (p for p in pairs if len(p) == 2) if a.distance < 0.8 * b.distance]
    points1 = np.array([keys1[m.queryIdx].pt for m in good])
    points2 = np.array([keys2[m.trainIdx].pt for m in good])
    if len(good) >= 8:
        pycolmap.estimate_fundamental_matrix(points1, points2)


def stages(photo: Path, folder: Path, repeats: int) -> dict[str, float]:
    """Return the median seconds of every step of an estimate, in process and warm."""
    from blur2view.cli.commands import main as command

    network = blur2view.SmearNetwork()
    run = Run(select=SelectOptions(), options=EstimatorOptions(), seed=0)
    one = estimate_file(photo, network, run)
    image, found = one.image, one.estimate
    grid, matches = found.grid, found.matches
    files = ResultFiles(folder=folder, stem="stages", endings=ESTIMATE)

    def whole() -> None:
        with redirect_stdout(StringIO()):
            command(["estimate", str(photo), "-o", str(folder), "--overwrite"])

    return {
        "decode": timed(lambda: blur2view.read_image(photo), repeats),
        "network": timed(lambda: network.predict(image), repeats),
        "matches": timed(lambda: select_matches(grid), repeats),
        "solve": timed(lambda: estimate_two_view(matches, rng=np.random.default_rng(0)), repeats),
        "draw and write": timed(
            lambda: write_files(result_contents(files, EstimateDocument.of(one), one)), repeats
        ),
        "motion mask": timed(lambda: blur2view.segment(found, image), repeats),
        "decode to F": timed(lambda: estimate(blur2view.read_image(photo), network=network), repeats),
        "command with all files, warm": timed(whole, max(3, repeats // 3)),
    }


def whole_process(photo: Path, folder: Path) -> tuple[float, float]:
    """Return wall seconds and peak memory (MiB) of one ``blur2view estimate`` process."""
    arguments = [sys.executable, "-m", "blur2view", "estimate", str(photo), "-o", str(folder), "--overwrite"]
    start = time.perf_counter()
    subprocess.run(arguments, check=True, stdout=subprocess.DEVNULL)
    seconds = time.perf_counter() - start
    return seconds, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def page(times: dict[str, float], process: tuple[float, float], rival: float, repeats: int) -> str:
    """Return markdown of the figures, each beside its ratio to the classical alternative."""
    named = {**times, "whole process, all files": process[0], "classical: two sharp frames": rival}
    rows = [(name, f"{seconds:.3f}", f"{seconds / rival:.2f}") for name, seconds in named.items()]
    words = f"{machine()}; medians of {repeats} runs; one {SIZE[0]}x{SIZE[1]} photograph."
    lines = table("step | seconds | over the classical alternative", rows)
    return "\n".join([words, "", *lines, "", f"Peak memory of the whole process: {process[1]:.0f} MiB.", ""])


def machine() -> str:
    """Return the name of the processor and the number of cores that this process may use."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor()}, {len(os.sched_getaffinity(0))} cores"


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--out", type=target, help="write OUT.md")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_scene(SCENE, folder, replace(test_options(None, SIZE), detail=1.0, smear_px=(15.0, 20.0)))
        photo = folder / f"{SCENE:04d}.png"
        ends = [folder / f"{SCENE:04d}_{end}.png" for end in ("open", "close")]
        process = [whole_process(photo, folder / "out") for _ in range(3)]
        times = stages(photo, folder / "out", arguments.repeats)
        rival = timed(lambda: classical(*ends), arguments.repeats)
        picture = np.asarray(cv2.imread(str(photo)))
        cv2.imwrite(str(folder / "large.jpg"), cv2.resize(picture, LARGE))
        large = whole_process(folder / "large.jpg", folder / "out")
    wall = median(seconds for seconds, _ in process)
    text = page(times, (wall, process[-1][1]), rival, arguments.repeats)
    text += f"\nA photograph of {LARGE[0]}x{LARGE[1]}: {large[0]:.1f} s, {large[1]:.0f} MiB, whole process.\n"
    publish(text, arguments.out and arguments.out.with_suffix(".md"))


if __name__ == "__main__":
    main()
