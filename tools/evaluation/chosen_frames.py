"""What choosing frames with `blur2view triage` is worth, beside a Laplacian and FFmpeg's blurdetect.

``python -m tools.evaluation.chosen_frames WORK --out tools/results/chosen_frames.md`` renders videos of a
hand's shake with exact poses (`tools.rendering.video`); ``--recorded MODEL FRAMES``, COLMAP's model of all
frames of a recording and the folder of them, adds that one. What it costs says `tools.evaluation.benchmark`.
A second table has other ways to choose one of some neighbours; `blur2view.cli.choosing` cites it.
"""

import csv
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from shutil import which
from typing import Any, NamedTuple

import cv2
import numpy as np

import blur2view
from blur2view.arrays import Array
from blur2view.cli.choosing import LEAST, NEIGHBOURS, sharpness_rank
from blur2view.images.pixels import gradient_energy
from blur2view.networks.smear_network import Detail, SmearNetwork
from blur2view.records.record import Record
from tools.command import Existing, Target, publish, run, table
from tools.rendering.video import VideoOptions, smear_lengths_px, write_video

OPTIONS = VideoOptions(rate=30, share=0.5, frames=60, size=(640, 480), focal_px=576, shake_px=56 / 3)
EVERY = 6, 10  # neighbours of which one is kept
COUNTS = range(3, 16)  # neighbours over which ways to choose are averaged
SHOWN = 6, 10, 15
HEAD = "video | way | rank correlation" + "".join(f" | 1 of {every}" for every in EVERY)
WAYS_HEAD = f"way | {' | '.join(f'1 of {count}' for count in SHOWN)} | mean, 1 of {COUNTS[0]} to {COUNTS[-1]}"
WAYS_LEAD = """\
Ways to choose one of N neighbours, averaged over the videos and all first frames: a share of them, two at
least, that has the most gradient energy (of both directions, or the sum of squares) is read by the network,
and of these that one is kept which the rest of the line names."""
LEAD = """\
*Rank correlation* of a measure of blur with the true length of the smears, over all frames. *1 of N*: the
mean true length of what is kept of every N frames over that of the least blurred of them, 1.00 at best;
*first* keeps the first of each."""


class Frame(NamedTuple):
    """A frame: the true length of its smears, pixels, and what is measured; more energy is sharper."""

    true: float
    record: Record
    energy: float
    squares: float
    laplacian: float


class Way(NamedTuple):
    """A way to choose: the measure and share by which the network reads frames, and the rank of these."""

    measure: Callable[[Frame], float]
    share: int
    rank: Callable[[Frame], Any]

    def chosen(self, frames: Sequence[Frame]) -> Frame:
        """Return the frame that is kept of neighbours."""
        read = list[Frame]()
        for part in np.array_split(np.arange(len(frames)), -(-len(frames) // NEIGHBOURS)):
            count = max(-(-len(part) // self.share), min(LEAST, self.share))
            read += sorted((frames[k] for k in part), key=self.measure, reverse=True)[:count]
        return min(read, key=self.rank)


WAYS = {
    "all, width of the blur": Way(attrgetter("energy"), 1, lambda one: sharpness_rank(one.record)),
    "a third by the squares, width": Way(attrgetter("squares"), 3, lambda one: sharpness_rank(one.record)),
    "a third, width": Way(attrgetter("energy"), 3, lambda one: sharpness_rank(one.record)),
    **{
        f"{name}, width over energy": Way(
            attrgetter("energy"), share, lambda one: sharpness_rank(one.record, one.energy)
        )
        for share, name in ((3, "a third"), (4, "a quarter"), (5, "a fifth"))
    },
    "all, energy": Way(attrgetter("energy"), 1, lambda one: -one.energy),
    "all, variance of the Laplacian": Way(attrgetter("energy"), 1, lambda one: one.laplacian),
}


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


def frames_of(paths: Sequence[Path], true: Sequence[float]) -> list[Frame]:
    """Return what is measured of the frames of a video, by one look at each, as where neighbours compete."""
    network, frames = SmearNetwork(threads=1), list[Frame]()
    for path, length in zip(paths, true, strict=True):
        image = blur2view.read_image(path)
        look = blur2view.estimate(image, network=network, detail=Detail.RANKING, geometry=False, closer=False)
        pixels = np.asarray(cv2.imread(str(path)))[..., ::-1]
        gradients = [
            cv2.Sobel(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), cv2.CV_32F, *d) for d in ((1, 0), (0, 1))
        ]
        frames.append(
            Frame(
                true=length,
                record=look.record().with_use(),
                energy=gradient_energy(pixels),
                squares=float(sum((one**2).mean() for one in gradients)),
                laplacian=laplacian(path),
            )
        )
    return frames


def way_rows(videos: Sequence[Sequence[Frame]]) -> Iterator[tuple[str, ...]]:
    """Yield the row of each way: mean true length of what it keeps over that of the least blurred."""
    for name, way in WAYS.items():
        means = dict[int, float]()
        for count in COUNTS:
            ratios = []
            for frames in videos:
                for first in range(count):
                    groups = [frames[k : k + count] for k in range(first, len(frames) - count + 1, count)]
                    kept, best = (
                        [f(group) for group in groups]
                        for f in (way.chosen, lambda g: min(g, key=attrgetter("true")))
                    )
                    ratios.append(np.mean([one.true for one in kept]) / np.mean([one.true for one in best]))
            means[count] = float(np.mean(ratios))
        yield name, *(f"{means[count]:.2f}" for count in SHOWN), f"{np.mean(list(means.values())):.3f}"


def main(
    work: Target,
    *,
    videos: int = 3,
    recorded: tuple[Existing, Existing] | None = None,
    out: Target | None = None,
) -> None:
    """Render videos of the first seeds into WORK, choose, and write the page."""
    work.mkdir(exist_ok=True)
    every, measured = list[tuple[str, ...]](), list[list[Frame]]()
    for seed in range(videos):
        folder = work / f"seed{seed}"
        true = smear_lengths_px(write_video(folder, seed, OPTIONS), seed, OPTIONS)
        frames = sorted(folder.glob("f_*.png"))
        every += list(rows(f"rendered, {seed}", folder, frames, true, work))
        measured.append(frames_of(frames, true))
    if recorded is not None:
        model, folder = recorded
        lengths = recorded_lengths_px(model)
        frames = [folder / name for name in lengths]
        every += list(rows(folder.name, folder, frames, list(lengths.values()), work))
        measured.append(frames_of(frames, list(lengths.values())))
    publish(out, LEAD, table(HEAD, every), WAYS_LEAD, table(WAYS_HEAD, way_rows(measured)))


if __name__ == "__main__":
    run(main)
