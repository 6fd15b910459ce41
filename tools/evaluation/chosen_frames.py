"""What choosing frames with `blur2view triage` is worth, beside a Laplacian and FFmpeg's blurdetect.

``python -m tools.evaluation.chosen_frames WORK --out tools/results/chosen_frames.md`` renders videos of a
hand's shake with exact poses (`tools.rendering.video`); ``--recorded MODEL FRAMES``, COLMAP's model of all
frames of a recording and the folder of them, adds that one. What it costs says `tools.evaluation.benchmark`.
"""

import csv
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from shutil import which

import cv2
import numpy as np

from blur2view.arrays import Array
from tools.command import Existing, Target, publish, run, table
from tools.rendering.video import VideoOptions, smear_lengths_px, write_video

OPTIONS = VideoOptions(rate=30, share=0.5, frames=60, size=(640, 480), focal_px=576, shake_px=56 / 3)
EVERY = 6, 10  # neighbours of which one is kept
HEAD = "video | way | rank correlation" + "".join(f" | 1 of {every}" for every in EVERY)
LEAD = """\
*Rank correlation* of a measure of blur with the true length of the smears, over all frames. *1 of N*: the
mean true length of what is kept of every N frames over that of the least blurred of them, 1.00 at best;
*first* keeps the first of each."""


def recorded_lengths_px(model: Path) -> dict[str, float]:
    """Return how far the picture moves a frame, by the name of the frame, pixels.

    It is the median of the points that a frame sees, from the frame before to the frame behind it.
    """
    import pycolmap

    scene = pycolmap.Reconstruction(model)
    images = sorted(scene.images.values(), key=lambda image: str(image.name))
    lengths = {}
    for k, image in enumerate(images):
        before, behind = max(k - 1, 0), min(k + 1, len(images) - 1)
        seen = [scene.points3D[p.point3D_id].xyz for p in image.points2D if p.has_point3D()]
        points: Array = np.column_stack([seen, np.ones(len(seen))])
        ends = list[Array]()
        for other in (images[before], images[behind]):
            at = points @ np.asarray(other.cam_from_world().matrix()).T
            ends.append(np.asarray(scene.cameras[other.camera_id].img_from_cam(at)))
        moved = np.median(np.linalg.norm(ends[1] - ends[0], axis=1))
        lengths[str(image.name)] = float(moved) / (behind - before)
    return lengths


def rank_correlation(first: Sequence[float], second: Sequence[float]) -> float:
    """Return Spearman's correlation of two series without ties."""
    ranks = np.argsort(np.argsort([first, second])).astype(float)
    return float(np.corrcoef(ranks)[0, 1])


def groups_of(count: int, every: int) -> list[range]:
    """Return the groups of neighbours."""
    edges = [*range(0, count, every), count]
    return [range(first, last) for first, last in pairwise(edges)]


def regret(true: Sequence[float], kept: Sequence[int], every: int) -> float:
    """Return the mean true length of kept frames over that of the least blurred of every few."""
    best = [min(true[k] for k in group) for group in groups_of(len(true), every)]
    return float(np.mean([true[k] for k in kept]) / np.mean(best))


def least(blur: Sequence[float], every: int) -> list[int]:
    """Return the least blurred of every few frames."""
    return [min(group, key=blur.__getitem__) for group in groups_of(len(blur), every)]


def laplacian(frame: Path) -> float:
    """Return minus the variance of the Laplacian, the common measure of sharpness."""
    grey = np.asarray(cv2.imread(str(frame), cv2.IMREAD_GRAYSCALE))
    return -float(cv2.Laplacian(grey, cv2.CV_64F).var())


def blurdetect(folder: Path, suffix: str) -> list[float]:
    """Return FFmpeg's measure of blur of the frames of a folder."""
    words = ["ffmpeg", "-v", "error", "-pattern_type", "glob", "-i", f"{folder}/*{suffix}"]
    words += ["-vf", "blurdetect,metadata=print:file=-", "-f", "null", "-"]
    printed = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    return [float(value) for value in re.findall(r"lavfi\.blur=([\d.]+)", printed)]


def triage(folder: Path, work: Path, *words: object) -> Path:
    """Return what a call of triage has written: a table of all frames, or the list of those that it keeps."""
    target = work / f"{folder.name}{'_'.join(map(str, words))}.txt"
    call = [sys.executable, "-m", "blur2view", "triage", folder, *words, target, "-q"]
    subprocess.run(list(map(str, call)), check=True)
    return target


def rows(
    title: str, folder: Path, frames: Sequence[Path], true: Sequence[float], work: Path
) -> Iterator[tuple[str, ...]]:
    """Yield the rows of a video, given as the folder of its frames, with the true lengths of the smears."""
    names = [frame.name for frame in frames]
    with triage(folder, work, "--csv").open() as lines:
        found = {row["name"]: row for row in csv.DictReader(lines)}
    blur = {"first": [], "variance of the Laplacian": [laplacian(frame) for frame in frames]}
    if which("ffmpeg"):
        blur["FFmpeg's blurdetect"] = blurdetect(folder, frames[0].suffix)
    blur["`triage`, all frames"] = [float(found[name]["blur_px"] or "inf") for name in names]
    for way, values in blur.items():
        kept = [least(values, n) if values else range(0, len(true), n) for n in EVERY]
        rank = f"{rank_correlation(values, true):.2f}" if values else ""
        yield title, way, rank, *(f"{regret(true, own, n):.2f}" for own, n in zip(kept, EVERY, strict=True))
    lists = [triage(folder, work, "--every-best", n, "--keep").read_text().split() for n in EVERY]
    chosen = [[names.index(name) for name in own] for own in lists]
    ratios = (f"{regret(true, own, n):.2f}" for own, n in zip(chosen, EVERY, strict=True))
    yield title, "`triage --every-best N`", "", *ratios


def main(
    work: Target,
    *,
    videos: int = 3,
    recorded: tuple[Existing, Existing] | None = None,
    out: Target | None = None,
) -> None:
    """Render videos of the first seeds into WORK, choose, and write the page."""
    work.mkdir(exist_ok=True)
    every = list[tuple[str, ...]]()
    for seed in range(videos):
        folder = work / f"seed{seed}"
        true = smear_lengths_px(write_video(folder, seed, OPTIONS), seed, OPTIONS)
        every += list(rows(f"rendered, {seed}", folder, sorted(folder.glob("f_*.png")), true, work))
    if recorded is not None:
        model, folder = recorded
        lengths = recorded_lengths_px(model)
        frames = [folder / name for name in lengths]
        every += list(rows(folder.name, folder, frames, list(lengths.values()), work))
    publish(out, LEAD, table(HEAD, every))


if __name__ == "__main__":
    run(main)
