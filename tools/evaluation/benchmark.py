"""Where the time of one estimate goes, and the classical alternative beside it, in one run.

    python -m tools.evaluation.benchmark --out tools/results/benchmark

renders one 1280x720 scene, measures every step of ``blur2view estimate`` on the blurred photograph, and SIFT,
matching and pycolmap's F on the two SHARP ends of the same exposure; then whole processes from outside: what
they do before they read a photograph, photographs of 1280x720 and of 12 and 24 megapixels, blurred and sharp,
and ``blur2view triage`` of videos by one process. ``--against COMMIT`` measures an earlier commit's processes
beside ours, in turn. Speeds of machines differ: read the ratios.
"""

import os
import platform
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

import blur2view
from blur2view.cli.outputs import estimate_contents
from blur2view.output_files import write_files
from blur2view.pipeline import Run, estimate, estimate_file
from blur2view.smears.selection import SelectOptions, select_matches
from blur2view.two_view.estimate import estimate_two_view
from blur2view.two_view.options import EstimatorOptions
from tools.arguments import parser_of, target
from tools.datasets.testset import test_options, write_scene
from tools.evaluation.processes_timed import (
    FRAMES,
    ROOT,
    STEPS,
    VIDEOS,
    checkout,
    in_turn,
    write_large,
    write_video,
)
from tools.evaluation.processes_timed import Run as Timed
from tools.pages import publish, table

Row = tuple[str, ...]
SIZE = (1280, 720)
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
        now = in_turn(roots, ["-c", code], repeats)[0].wall_s
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
        first = first or runs[0].wall_s
        rows.append(row_of(name, runs, f"{runs[0].wall_s / first:.2f}"))
    return rows, first


def triage_rows(roots: Sequence[Path], blurred: Path, sharp: Path, folder: Path, repeats: int) -> list[Row]:
    """Return rows of the triage of videos by one process, in frames a second."""
    rows = []
    for name, size in VIDEOS.items():
        video = write_video(folder / f"{name}.avi", blurred, sharp, size)
        runs = in_turn(roots, ["-m", "blur2view", "triage", video, "--jobs", "1"], repeats)
        rows.append(
            row_of(f"triage, video of {name}", runs, f"{FRAMES / runs[0].wall_s:.1f} frames a second")
        )
    return rows


def row_of(name: str, runs: Sequence[Timed], word: str) -> Row:
    """Return a row: seconds of wall and processor, MiB, a word, and the same ratios to another tree's run."""
    own = runs[0]
    cells = name, f"{own.wall_s:.2f}", f"{own.cpu_s:.2f}", f"{own.memory_mib:.0f}", word
    if len(runs) == 1:
        return cells
    return *cells, *(
        f"{getattr(own, key) / getattr(runs[1], key):.2f}" for key in ("wall_s", "cpu_s", "memory_mib")
    )


def page(times: dict[str, float], rival: float, repeats: int) -> str:
    """Return markdown of the steps, each beside its ratio to the classical alternative."""
    named = {**times, "classical: two sharp frames": rival}
    rows = [(name, f"{seconds:.3f}", f"{seconds / rival:.2f}") for name, seconds in named.items()]
    words = (
        f"{machine()}; medians of {repeats} runs; one {SIZE[0]}x{SIZE[1]} photograph, in process and warm."
    )
    return "\n".join([words, "", *table("step | seconds | over the classical alternative", rows), ""])


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
    parser.add_argument("--against", metavar="COMMIT", help="measure an earlier commit, too, in turn")
    parser.add_argument("--out", type=target, help="write OUT.md")
    arguments = parser.parse_args()
    few = max(3, arguments.repeats // 3)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        roots = [ROOT]
        if arguments.against:
            roots.append(checkout(arguments.against, folder / "earlier"))
        write_scene(SCENE, folder, replace(test_options(None, SIZE), detail=1.0, smear_px=(15.0, 20.0)))
        photo = folder / f"{SCENE:04d}.png"
        ends = [folder / f"{SCENE:04d}_{end}.png" for end in ("open", "close")]
        (folder / "out").mkdir()
        times = stages(photo, folder / "out", arguments.repeats)
        rival = timed(lambda: classical(*ends), arguments.repeats)
        pictures = {f"{SIZE[0]}x{SIZE[1]}": photo, **write_large(folder, photo, ends[0])}
        shell = before_reading(roots[:1], few)
        whole, first = whole_processes(roots, pictures, folder / "out", few)
        videos = triage_rows(roots, photo, ends[0], folder, few)
    ratio = first / times["decode to F"]
    head = "process | seconds | of processors | MiB | over the first, or rate"
    if arguments.against:
        head += f" | wall over {arguments.against} | processors | memory"
    lines = [
        page(times, rival, arguments.repeats),
        f"The whole process takes {ratio:.1f} times as long as from decoding to F.\n",
        *table("before a photograph is read | seconds | more than the step before", shell),
        "",
        *table(head, [*whole, *videos]),
    ]
    text = "\n".join([*lines, ""])
    publish(text, arguments.out and arguments.out.with_suffix(".md"))


if __name__ == "__main__":
    main()
