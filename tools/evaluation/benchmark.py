"""Where the time of one estimate goes, and the classical alternative beside it, in one run.

    python -m tools.evaluation.benchmark --out tools/results/benchmark

renders one 1280x720 scene, measures every step of ``blur2view estimate`` on the blurred photograph, and SIFT,
matching and pycolmap's F on the two SHARP ends of the same exposure; then whole processes from outside: what
they do before they read a photograph, photographs of 1280x720 and of 12 and 24 megapixels, blurred and sharp,
and ``blur2view triage`` of videos by one process. ``--against COMMIT`` measures an earlier commit's processes
beside ours, in turn. Speeds of machines differ: read the ratios.
"""

import compileall
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import blur2view
from blur2view.cli.estimate import estimate_contents
from blur2view.output_files import write_files
from blur2view.pipeline import Run, estimate, estimate_file
from blur2view.smears.selection import SelectOptions, select_matches
from blur2view.two_view.estimate import estimate_two_view
from blur2view.two_view.options import EstimatorOptions
from tools.arguments import Target, run
from tools.datasets.testset import test_options, write_scene
from tools.pages import joined, publish, table

Row = tuple[str, ...]
SIZE = (1280, 720)
SCENE = 3  # index in the test split of the scene that is timed
ROOT = Path(__file__).resolve().parents[2]
LARGE = {"12 megapixels": (4000, 3000), "24 megapixels": (6000, 4000)}
VIDEOS = {"1280x720": (1280, 720), "1920x1080": (1920, 1080)}
FRAMES = 24
STEPS = {
    "Python": "",
    "Python and NumPy": "import numpy",
    "imports of the command": "import blur2view.cli.estimate",
    "the network, loaded": "import blur2view.cli.estimate; blur2view.SmearNetwork()",
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
    one = estimate_file(photo, network, Run(select=SelectOptions(), options=EstimatorOptions(), seed=0))
    image, found = one.image, one.estimate
    grid, matches = found.grid, found.matches
    names = folder / "stages.smear.npz", folder / "stages.png"

    def whole() -> None:
        with redirect_stdout(StringIO()):
            command(["estimate", str(photo), "-o", str(folder), "--overwrite"])

    return {
        "decode": timed(lambda: blur2view.read_image(photo), repeats),
        "network": timed(lambda: network.predict(image), repeats),
        "matches": timed(lambda: select_matches(grid), repeats),
        "solve": timed(lambda: estimate_two_view(matches, rng=np.random.default_rng(0)), repeats),
        "draw and write": timed(
            lambda: write_files(dict(zip(names, estimate_contents(one), strict=True))), repeats
        ),
        "motion mask": timed(lambda: blur2view.segment(found, image), repeats),
        "decode to F": timed(lambda: estimate(blur2view.read_image(photo), network=network), repeats),
        "command with all files, warm": timed(whole, max(3, repeats // 3)),
    }


def before_reading(roots: Sequence[Path], repeats: int) -> list[Row]:
    """Return rows of what a process takes before it reads a photograph, step by step."""
    rows, earlier = list[Row](), 0.0
    for name, code in STEPS.items():
        now = in_turn(roots, ["-c", code], repeats)[0][0]
        rows.append((name, f"{now:.3f}", f"{now - earlier:.3f}"))
        earlier = now
    return rows


def whole_processes(
    roots: Sequence[Path], pictures: Mapping[str, Path], folder: Path, repeats: int
) -> tuple[list[Row], float]:
    """Return rows of whole processes of photographs, over the first one of this tree, which is given, too."""
    rows, first = list[Row](), 0.0
    for name, path in pictures.items():
        arguments: list[str | Path] = ["-m", "blur2view", "estimate", path, "-o", folder, "--overwrite"]
        runs = in_turn(roots, arguments, repeats)
        first = first or runs[0][0]
        rows.append(row_of(name, runs, f"{runs[0][0] / first:.2f}"))
    return rows, first


def triage_rows(roots: Sequence[Path], blurred: Path, sharp: Path, folder: Path, repeats: int) -> list[Row]:
    """Return rows of the triage of videos by one process, in frames a second."""
    rows = []
    for name, size in VIDEOS.items():
        video = write_video(folder / f"{name}.avi", blurred, sharp, size)
        runs = in_turn(roots, ["-m", "blur2view", "triage", video, "--jobs", "1"], repeats)
        rows.append(row_of(f"triage, video of {name}", runs, f"{FRAMES / runs[0][0]:.1f} frames a second"))
    return rows


def row_of(name: str, runs: Sequence[Taken], word: str) -> Row:
    """Return a row: seconds of wall and processor, MiB, a word, and the same ratios to another tree's run."""
    wall_s, cpu_s, memory_mib = runs[0]
    ratios = (f"{ratio:.2f}" for other in runs[1:] for ratio in runs[0] / other)
    return name, f"{wall_s:.2f}", f"{cpu_s:.2f}", f"{memory_mib:.0f}", word, *ratios


def measured(root: Path, arguments: Sequence[str | Path]) -> list[float]:
    """Return what a Python process took that imports this package from a source tree, as `Taken` has it."""
    environment = os.environ | {"PYTHONPATH": str(root)}
    words = [sys.executable, "-c", LAUNCHER, *map(str, arguments)]
    done = subprocess.run(words, stdout=subprocess.PIPE, env=environment, cwd=root, check=True)
    code, wall_s, cpu_s, memory = json.loads(done.stdout)
    if code:
        raise SystemExit(f"{root}: {' '.join(map(str, arguments))} ends with {code}")
    return [wall_s, cpu_s, memory / (2**20 if sys.platform == "darwin" else 2**10)]


def in_turn(roots: Sequence[Path], arguments: Sequence[str | Path], repeats: int) -> list[Taken]:
    """Return the medians of each tree's runs; the trees take turns, so that both see the same machine."""
    runs = [[measured(root, arguments) for root in roots] for _ in range(repeats)]
    return list(np.median(runs, axis=0))


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


def step_table(times: dict[str, float], rival: float) -> list[str]:
    """Return the steps as lines of Markdown, each beside its ratio to the classical alternative."""
    named = {**times, "classical: two sharp frames": rival}
    rows = [(name, f"{seconds:.3f}", f"{seconds / rival:.2f}") for name, seconds in named.items()]
    return table("step | seconds | over the classical alternative", rows)


def machine() -> str:
    """Return the name of the processor and the number of cores that this process may use."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor()}, {len(os.sched_getaffinity(0))} cores"


def main(*, repeats: int = 9, against: str | None = None, out: Target | None = None) -> None:
    """Measure, beside an earlier commit if wanted, and write OUT.md."""
    few = max(3, repeats // 3)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        roots = [ROOT]
        if against:
            roots.append(checkout(against, folder / "earlier"))
        for root in roots:
            compileall.compile_dir(root / "blur2view", quiet=1)  # as pip does
        write_scene(SCENE, folder, replace(test_options(None, SIZE), detail=1.0, smear_px=(15.0, 20.0)))
        photo = folder / f"{SCENE:04d}.png"
        ends = [folder / f"{SCENE:04d}_{end}.png" for end in ("open", "close")]
        (folder / "out").mkdir()
        times = stages(photo, folder / "out", repeats)
        rival = timed(lambda: classical(*ends), repeats)
        pictures = {f"{SIZE[0]}x{SIZE[1]}": photo, **write_large(folder, photo, ends[0])}
        shell = before_reading(roots[:1], few)
        whole, first = whole_processes(roots, pictures, folder / "out", few)
        videos = triage_rows(roots, photo, ends[0], folder, few)
    head = "process | seconds | of processors | MiB | over the first, or rate"
    if against:
        head += f" | wall over {against} | processors | memory"
    words = (
        f"{machine()}; medians of {repeats} runs; one {SIZE[0]}x{SIZE[1]} photograph, in process and warm."
    )
    ratio = first / times["decode to F"]
    text = joined(
        words,
        step_table(times, rival),
        f"The whole process takes {ratio:.1f} times as long as from decoding to F.",
        table("before a photograph is read | seconds | more than the step before", shell),
        table(head, [*whole, *videos]),
    )
    publish(text, out and out.with_suffix(".md"))


if __name__ == "__main__":
    run(main)
