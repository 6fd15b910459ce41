"""GoPro and RBI: real frames; smears by computed flow between the sharp frames at both ends."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.errors import Blur2ViewError
from tools.datasets.exposure import Exposure, Reader, linearised, numbered, read_frame, require_folder
from tools.datasets.flow import (
    CROSS_CHECK_PX,
    MidSmears,
    averaged,
    computed_flow,
    disagreement,
    inside,
    mid_smears,
    sub_frames,
)
from tools.rendering.exposure import pixel_grid

NAME = re.compile(r"GOPR\d+_(\d+)_\d+")
"""GoPro's sequences; the number in the middle says how many sharp frames make a blurred one."""
SHARP_A_PERIOD, SHARP_AN_EXPOSURE = 20, 9
"""RBI: sharp frames from one blurred frame to the next, and during the exposure of one."""


def averaged_frames(sequence: Path) -> int:
    """Return the number of sharp frames of one exposure that a sequence's name tells."""
    match = NAME.fullmatch(sequence.name)
    if match is None or int(match[1]) < 2:
        raise Blur2ViewError(f"{sequence}: expected a name such as GOPR0384_11_00 (11 frames an exposure)")
    return int(match[1])


class GoProSharp(Reader):
    """GOPRO_Large_all: all sharp frames, 240 a second, such as ``test/GOPR0384_11_00/000001.png``.

    Exposures are runs of as many frames as the dataset's own (see NAME), or of `window`, that do not overlap,
    averaged in linear light, with further frames in between where they are far apart. The coding is taken to
    be sRGB's.
    """

    def __init__(self, root: Path, split: str = "test", window: int | None = None) -> None:
        if window is not None and window < 2:
            raise ValueError(f"an exposure needs at least two frames, got {window}")
        self.folder, self.window = require_folder(root / split, "GOPRO_Large_all's frames"), window
        self.sequences = sorted(p for p in self.folder.iterdir() if p.is_dir() and numbered(p))
        if not self.sequences:
            raise Blur2ViewError(
                f"{self.folder}: holds no folders of numbered PNG files; GOPRO_Large is read by --kind gopro"
            )

    def unread(self) -> Iterator[Callable[[], Exposure]]:
        """Yield what reads the exposures of every sequence in order."""
        for sequence in self.sequences:
            paths, window = list(numbered(sequence).values()), self.window or averaged_frames(sequence)
            for start in range(0, len(paths) - window + 1, window):
                chosen = paths[start : start + window]
                yield partial(from_sharp, f"{sequence.name}_{chosen[0].stem}", chosen)


def from_sharp(name: str, paths: Sequence[Path]) -> Exposure:
    """Return a run of sharp frames blurred; its first and last are the ends of the exposure."""
    frames = [read_frame(path) for path in paths]
    forward, backward = computed_flow(frames[0], frames[-1])
    smears = mid_smears(forward, backward)
    gaps = len(frames) - 1
    each = -(-sub_frames(smears.displacement, smears.valid) // gaps)
    total = np.zeros(frames[0].shape, np.float32)
    for one, other in zip(frames[:-1], frames[1:], strict=True):
        total += averaged(linearised(one), linearised(other), *computed_flow(one, other), each)
    return Exposure(
        name=name, linear=total / np.float32(gaps), first=frames[0], last=frames[-1], smears=smears
    )


class GoProPairs(Reader):
    """GOPRO_Large: ``test/GOPR0384_11_00`` with ``blur_gamma``, ``blur`` and ``sharp``, the middle frames.

    ``blur_gamma`` is what was averaged in linear light, and preferred. There are no sharp frames at the ends.
    Exposures follow each other without a gap, so of n frames each a smear is half of the flow from the sharp
    frame before to the one after, times (n - 1) / n. `first` and `last` are those neighbouring frames:
    further apart than the ends of the exposure.
    """

    def __init__(self, root: Path, split: str = "test") -> None:
        self.folder = require_folder(root / split, "GOPRO_Large's sequences")
        self.sequences = sorted(p for p in self.folder.iterdir() if (p / "blur").is_dir())
        if not self.sequences:
            raise Blur2ViewError(
                f"{self.folder}: holds no sequence with a folder blur; GOPRO_Large_all is read by "
                "--kind gopro-sharp"
            )
        for sequence in self.sequences:
            require_folder(sequence / "sharp", "the sharp frames of blur")
            averaged_frames(sequence)

    def unread(self) -> Iterator[Callable[[], Exposure]]:
        """Yield what reads the exposures that have a neighbour on both sides."""
        for sequence in self.sequences:
            linear = sequence / "blur_gamma"
            blurred, sharp = (
                numbered(folder)
                for folder in (linear if linear.is_dir() else sequence / "blur", sequence / "sharp")
            )
            if list(blurred) != list(sharp):
                raise Blur2ViewError(f"{sequence}: blur and sharp hold different frames; unpack it again")
            count, numbers = averaged_frames(sequence), list(blurred)
            for near in zip(numbers, numbers[1:], numbers[2:], strict=False):
                name, number = f"{sequence.name}_{near[1]:06d}", near[1]
                yield partial(from_pair, name, blurred[number], [sharp[k] for k in near], (count - 1) / count)


def from_pair(name: str, blurred: Path, sharp: Sequence[Path], share: float) -> Exposure:
    """Return the exposure of a blurred frame, and the sharp ones before, at and after it."""
    first, middle, last = map(read_frame, sharp)
    return Exposure(
        name=name,
        linear=linearised(read_frame(blurred)),
        first=first,
        last=last,
        smears=half_way(first, middle, last, share),
    )


def half_way(first: AnyArray, middle: AnyArray, last: AnyArray, share: float) -> MidSmears:
    """Return the smears of an exposure about a middle frame, `share` of the time between two frames long."""
    pixels = pixel_grid((middle.shape[1], middle.shape[0]))
    (ahead, returned), (back, advanced) = (computed_flow(middle, other) for other in (last, first))
    checked = (disagreement(ahead, returned, pixels) < CROSS_CHECK_PX) & (
        disagreement(back, advanced, pixels) < CROSS_CHECK_PX
    )
    displacement = np.float32(share / 2) * (ahead - back)
    ends_seen = inside(pixels - displacement / 2) & inside(pixels + displacement / 2)
    return MidSmears(displacement=displacement, valid=checked & ends_seen)


class RBI(Reader):
    """RBI: ``Blur/_Scene1/RGB/1.png`` and ``Sharp/_Scene1/RGB/1.png``.

    Blurred frame k was exposed while the sharp camera took its frames 20 (k - 1) + 1 to 20 (k - 1) + 9.
    """

    def __init__(self, root: Path) -> None:
        self.blur, self.sharp = (require_folder(root / name, "RBI") for name in ("Blur", "Sharp"))
        self.scenes = sorted(p.name for p in self.blur.iterdir() if p.is_dir())
        if not self.scenes:
            raise Blur2ViewError(f"{self.blur}: holds no scenes; unpack RBI again")
        for scene in self.scenes:
            require_folder(self.sharp / scene / "RGB", "the sharp frames of a scene")

    def unread(self) -> Iterator[Callable[[], Exposure]]:
        """Yield what reads the exposures scene by scene."""
        for scene in self.scenes:
            folders = {p.parent for p in (self.blur / scene).rglob("*.png")}
            if len(folders) != 1:
                raise Blur2ViewError(
                    f"{self.blur / scene}: {len(folders)} folders of PNG files, expected one"
                )
            for number, path in numbered(folders.pop()).items():
                yield partial(self.exposure, scene, number, path)

    def exposure(self, scene: str, number: int, path: Path) -> Exposure:
        """Return the exposure of a blurred frame and the sharp frames at its ends."""
        start = SHARP_A_PERIOD * (number - 1) + 1
        ends = (self.sharp / scene / "RGB" / f"{k}.png" for k in (start, start + SHARP_AN_EXPOSURE - 1))
        first, last = (read_frame(end) for end in ends)
        blurred = read_frame(path)
        if not blurred.shape == first.shape == last.shape:
            raise Blur2ViewError(f"{path}: differs in size from its sharp frames; unpack RBI again")
        return Exposure(
            name=f"{scene.strip('_')}_{number:04d}",
            linear=linearised(blurred),
            first=first,
            last=last,
            smears=mid_smears(*computed_flow(first, last)),
        )
