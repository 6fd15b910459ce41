"""The paper's data sets as scenes that ``tools.evaluation.evaluate`` reads: Monkaa, Driving, GoPro, RBI.

``python -m tools.paper.datasets KIND ROOT --out DIR``, then ``python -m tools.evaluation.evaluate DIR``.
ROOT, unpacked as published, holds, for

- monkaa, driving (Scene Flow; an exposure lasts to the next frame, or ``--frames`` further)
  ``frames_cleanpass/SCENE/left/0000.png`` (or webp), ``camera_data/SCENE/camera_data.txt`` and
  ``optical_flow/SCENE/into_future/left/OpticalFlowIntoFuture_0000_L.pfm`` (and into_past);
- gopro (GOPRO_Large_all) ``test/GOPR0384_11_00/000001.png``: 11 sharp frames make an exposure;
- rbi ``Blur/SCENE/RGB/1.png``, ``Sharp/SCENE/RGB/1.png``: blurred frame k was exposed during `OPEN_FOR`
  sharp ones from `PERIOD` (k - 1) + 1.

As in the paper, points move straight and evenly between frames, max(2 s, 15) sub-frames are averaged in
linear light (RBI's are blurred), and a smear is valid where the flow forwards and backwards cancel to a
pixel. Flow is chained: Scene Flow's own, which is exact, else OpenCV's DIS. F is of Scene Flow's cameras,
else fitted to the true smears in their true order.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from blur2view.arrays import AnyArray, Array
from blur2view.errors import Blur2ViewError
from blur2view.geometry.epipolar import fundamental_from_pose
from tools.command import Existing, run
from tools.datasets.testset import write_truth
from tools.evaluation import baselines
from tools.rendering.render import GRID, grid_points, pixel_grid

CROSS_CHECK_PX = 1.0  # the paper's eps: how far a flow there and back may miss
SOLVED_PX, STEPS = 0.25, 12  # of fixed-point iterations: the miss of a solution, and their number
MIN_SUBFRAMES, MAX_SUBFRAMES = 15, 240  # of an exposure: the paper's least, and a bound
SENSOR_MM, FOCAL_MM, GUESSED_FOCAL = 32.0, 35.0, 1.2  # Blender's; in widths, as COLMAP guesses
CODES = np.arange(256) / 255
LIGHT = np.where(CODES <= 0.04045, CODES / 12.92, ((CODES + 0.055) / 1.055) ** 2.4).astype(np.float32)
"""Linear light of the 256 codes of sRGB (IEC 61966-2-1)."""
BLENDER: Array = np.diag([1.0, -1.0, -1.0])  # its camera looks along -z with y up
PERIOD, OPEN_FOR = 20, 9  # RBI's sharp frames from a blurred frame to the next, and during its exposure


@dataclass(frozen=True, kw_only=True, eq=False)
class Exposure:
    """Sharp frames (H, W, 3) uint8 of an exposure, with the flow from each to the next, and back."""

    frames: list[AnyArray]
    flows: list[tuple[AnyArray, AnyArray]]  # (H, W, 2) float32
    blurred: AnyArray | None = None  # (H, W, 3) uint8, where the set has it
    pose: tuple[Array, Array] = (np.full((3, 3), np.nan), np.full(3, np.nan))  # R, t of close from open
    focal_widths: float = GUESSED_FOCAL


def read(path: Path, how: int = cv2.IMREAD_COLOR) -> AnyArray:
    """Return a frame (H, W, 3), RGB, or a PFM file's values; Blur2ViewError if it is missing or broken."""
    if (picture := cv2.imread(str(path), how)) is None:
        raise Blur2ViewError(f"{path}: is missing or damaged; unpack the data set again")
    return np.ascontiguousarray(picture[..., ::-1])


def numbered(folder: Path) -> dict[int, Path]:
    """Return the pictures of a folder whose names are numbers, in order; Blur2ViewError without any."""
    paths = [p for p in folder.glob("*") if p.suffix in (".png", ".webp") and p.stem.isdigit()]
    if not paths:
        raise Blur2ViewError(f"{folder}: holds no numbered pictures; see help('tools.paper.datasets')")
    return dict(sorted((int(path.stem), path) for path in paths))


def read_cameras(path: Path) -> dict[int, Array]:
    """Return, by frame, the left world_from_camera (4, 4) of camera_data.txt, in Blender's axes."""
    text = path.read_text() if path.is_file() else ""
    if not (found := re.findall(r"Frame (\d+)\s+L((?:\s+[-+.\deE]+){16})", text)):
        raise Blur2ViewError(f"{path}: is missing or holds no cameras; unpack camera_data again")
    return {int(number): np.array(values.split(), float).reshape(4, 4) for number, values in found}


def scene_flow(root: Path, steps: int) -> Iterator[Exposure]:
    """Yield the exposures of Monkaa or Driving, each from a frame to the one ``steps`` later."""
    if not (folders := sorted(root.glob("frames_cleanpass*/**/left"))):
        raise Blur2ViewError(f"{root}: holds no frames_cleanpass/SCENE/left; unpack the frames again")
    for folder in folders:
        scene = Path(*folder.parent.relative_to(root).parts[1:])
        cameras, paths = read_cameras(root / "camera_data" / scene / "camera_data.txt"), numbered(folder)

        def flow(time: str, number: int, scene: Path = scene) -> AnyArray:
            name = f"OpticalFlowInto{time}_{number:04d}_L.pfm"
            path = root / "optical_flow" / scene / f"into_{time.lower()}" / "left" / name
            return np.nan_to_num(read(path, cv2.IMREAD_UNCHANGED)[..., :2], posinf=0, neginf=0)

        lens = re.search(r"(\d+)mm_focallength", str(scene))
        for first in list(paths)[::steps]:
            numbers = range(first, first + steps + 1)
            if set(numbers) <= paths.keys() & cameras.keys():
                moved = np.linalg.inv(cameras[numbers[-1]]) @ cameras[first]
                yield Exposure(
                    frames=[read(paths[number]) for number in numbers],
                    flows=[(flow("Future", a), flow("Past", b)) for a, b in pairwise(numbers)],
                    pose=(BLENDER @ moved[:3, :3] @ BLENDER, BLENDER @ moved[:3, 3]),
                    focal_widths=(float(lens[1]) if lens else FOCAL_MM) / SENSOR_MM,
                )


def gopro(root: Path, _: int) -> Iterator[Exposure]:
    """Yield the exposures of GOPRO_Large_all's test split; a sequence's name has their number of frames."""
    for folder in sorted(path for path in (root / "test").glob("*") if path.is_dir()):
        named = re.fullmatch(r"GOPR\d+_(\d+)_\d+", folder.name)
        if named is None or int(named[1]) < 2:
            raise Blur2ViewError(f"{folder}: expected a name as GOPR0384_11_00 (11 frames an exposure)")
        paths, count = list(numbered(folder).values()), int(named[1])
        for start in range(0, len(paths) - count + 1, count):
            frames = [read(path) for path in paths[start : start + count]]
            yield Exposure(frames=frames, flows=dis(frames))


def rbi(root: Path, _: int) -> Iterator[Exposure]:
    """Yield the exposures of RBI, blurred by its own camera."""
    for folder in sorted((root / "Blur").glob("*/RGB")):
        sharp = root / "Sharp" / folder.relative_to(root / "Blur")
        for number, path in numbered(folder).items():
            first = PERIOD * (number - 1) + 1
            frames = [read(sharp / f"{k}.png") for k in range(first, first + OPEN_FOR)]
            yield Exposure(frames=frames, flows=dis(frames), blurred=read(path))


KINDS = {"monkaa": scene_flow, "driving": scene_flow, "gopro": gopro, "rbi": rbi}


def dis(frames: list[AnyArray]) -> list[tuple[AnyArray, AnyArray]]:
    """Return OpenCV's DIS flow (Kroeger et al., ECCV 2016) from each frame to the next, and back."""
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    flow.setFinestScale(0)
    grey = [cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in frames]
    none = np.zeros((*grey[0].shape, 2), np.float32)
    return [(flow.calc(a, b, none.copy()), flow.calc(b, a, none.copy())) for a, b in pairwise(grey)]


def sampled(values: AnyArray, at: AnyArray) -> AnyArray:
    """Return a field (H, W, C) interpolated at positions (H, W, 2), its border repeated."""
    at = at.astype(np.float32)
    return np.asarray(cv2.remap(values, at[..., 0], at[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE))


def chained(flows: list[AnyArray]) -> AnyArray:
    """Return the flow (H, W, 2) from the first frame to the last, of the flows from each to the next."""
    total = np.zeros_like(flows[0])
    for flow in flows:
        total += sampled(flow, pixel_grid(total.shape[1::-1]) + total)
    return total


def sources(flow: AnyArray, share: float) -> tuple[AnyArray, AnyArray]:
    """Return where points start (H, W, 2) that a share of their flow brings to each pixel, and the misses."""
    x = pixels = pixel_grid((flow.shape[1], flow.shape[0]))
    for _ in range(STEPS):
        x = pixels - np.float32(share) * sampled(flow, x)
    return x, np.linalg.norm(x + np.float32(share) * sampled(flow, x) - pixels, axis=-1)


def disagreement(forward: AnyArray, backward: AnyArray, at: AnyArray) -> AnyArray:
    """Return the distance (H, W) from positions (H, W, 2) to where the flow forwards and backwards leads."""
    there = sampled(forward, at)
    return np.asarray(np.linalg.norm(there + sampled(backward, at + there), axis=-1))


def mid_smears(exposure: Exposure) -> tuple[AnyArray, AnyArray]:
    """Return displacements (H, W, 2) from open to close, at mid-exposure pixels, and where they are valid."""
    forward = chained([there for there, _ in exposure.flows])
    backward = chained([back for _, back in exposure.flows[::-1]])
    start, miss = sources(forward, 0.5)
    smears, size = sampled(forward, start), np.array(forward.shape[1::-1])
    seen = (miss < SOLVED_PX) & (disagreement(forward, backward, start) < CROSS_CHECK_PX)
    ends = np.stack([start, start + smears])
    return smears, seen & ((ends >= 0) & (ends <= size - 1)).all(axis=(0, -1))


def average(exposure: Exposure, longest: float) -> AnyArray:
    """Return the mean (H, W, 3), uint8, of sub-frames, which blend two frames by time and cross-check."""
    count = -(-int(np.clip(np.ceil(longest), MIN_SUBFRAMES, MAX_SUBFRAMES)) // len(exposure.flows))
    total = np.zeros(exposure.frames[0].shape, np.float32)
    for (one, other), (forward, backward) in zip(pairwise(exposure.frames), exposure.flows, strict=True):
        ways = (LIGHT[one], forward, backward), (LIGHT[other], backward, forward)
        for tau in (np.arange(count) + 0.5) / count:
            blend, weight = np.zeros_like(total), np.zeros((*total.shape[:2], 1), np.float32)
            for (frame, there, back), part in zip(ways, (tau, 1 - tau), strict=True):
                x, miss = sources(there, part)
                trust = np.where(disagreement(there, back, x) < CROSS_CHECK_PX, 1, 0.05)
                own = (1 - part) * trust / (1 + (miss / SOLVED_PX) ** 4) + 1e-6
                blend = blend + own[..., None].astype(np.float32) * sampled(frame, x)
                weight = weight + own[..., None].astype(np.float32)
            total += blend / weight
    total /= count * len(exposure.flows)
    return np.searchsorted((LIGHT[1:] + LIGHT[:-1]) / 2, total).astype(np.uint8)  # the nearest code


def write_scene(exposure: Exposure, stem: Path, kind: str) -> None:
    """Write what `tools.datasets.testset.read_test_set` reads: the photograph and the truth."""
    (smears, valid), blurred, (R, t) = mid_smears(exposure), exposure.blurred, exposure.pose
    if blurred is None:
        blurred = average(exposure, float(np.linalg.norm(smears[valid], axis=-1).max(initial=0.0)))
    height, width = (side // GRID * GRID for side in blurred.shape[:2])
    middle = grid_points((width, height))
    four = [middle.astype(int) + np.array(step) for step in ((0, 0), (1, 0), (0, 1), (1, 1))]
    own = np.stack([smears[at[..., 1], at[..., 0]] for at in four])  # about a cell's centre
    even = np.linalg.norm(own - own.mean(axis=0), axis=-1).max(axis=0) < 1  # no edge cuts the cell
    known = even & np.all([valid[at[..., 1], at[..., 0]] for at in four], axis=0)
    d, f = own.mean(axis=0).astype(np.float32), exposure.focal_widths * blurred.shape[1]
    K = np.array([[f, 0, (blurred.shape[1] - 1) / 2], [0, f, (blurred.shape[0] - 1) / 2], [0, 0, 1]])
    ends = np.stack([middle - d / 2, middle + d / 2], axis=2)[known]
    F = fundamental_from_pose(K, R, t) if np.linalg.norm(t) > 1e-9 else None  # None of NaN, too
    F = baselines.solve(baselines.opencv, ends) if np.isnan(R).any() else F
    truth = {"displacement": d, "valid": known, "static": np.ones_like(known), "K": K, "R": R, "t": t}
    write_truth(stem.with_suffix(".npz"), blurred[:height, :width], kind=kind, F=F, **truth)


def main(
    kind: Literal["monkaa", "driving", "gopro", "rbi"],
    root: Existing,
    *,
    out: Path,
    frames: int = 1,
    scenes: int | None = None,
) -> None:
    """Write at most ``scenes`` scenes; an exposure of Scene Flow lasts ``frames`` frame intervals."""
    try:
        for index, exposure in enumerate(islice(KINDS[kind](root, max(frames, 1)), scenes)):
            write_scene(exposure, out / f"{index:04d}", kind)
    except Blur2ViewError as error:
        raise SystemExit(str(error)) from None


if __name__ == "__main__":
    run(main)
