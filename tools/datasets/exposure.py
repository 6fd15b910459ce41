"""One exposure of a dataset: the blurred photograph, its sharp ends, smears and cameras."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from blur2view.errors import Blur2ViewError
from blur2view.geometry.epipolar import fundamental_from_pose
from tools.datasets.flow import MidSmears
from tools.datasets.gold_standard import gold_standard_fundamental
from tools.rendering.textures import srgb_to_linear

GUESSED_FOCAL = 1.2
"""Focal length over the longer side where a dataset tells none, as COLMAP guesses: for angles of rays."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pose:
    """Intrinsics K (3, 3) and ``cam_close_from_cam_open`` R (3, 3), t (3,)."""

    K: AnyArray
    R: AnyArray
    t: AnyArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Exposure:
    """One exposure.

    Attributes
    ----------
    name : str
        Where it is from; letters, digits, dots, dashes and underscores.
    linear : ndarray of shape (H, W, 3)
        float32 linear light of the blurred photograph, white = 1.
    first, last : ndarray of shape (H, W, 3)
        uint8 sharp frames at both ends.
    smears : MidSmears
        Truth at mid-exposure pixels.
    pose : Pose or None
        Where the dataset knows its cameras.
    """

    name: str
    linear: AnyArray
    first: AnyArray
    last: AnyArray
    smears: MidSmears
    pose: Pose | None = None

    @property
    def photograph(self) -> AnyArray:
        """The blurred photograph (H, W, 3), uint8."""
        return coded(self.linear)

    @property
    def K(self) -> AnyArray:
        """Intrinsics, guessed where the dataset tells none."""
        if self.pose is not None:
            return self.pose.K
        height, width = self.linear.shape[:2]
        focal = GUESSED_FOCAL * max(width, height)
        return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])

    def fundamental(self) -> AnyArray | None:
        """Return the true F: the cameras', else the gold standard of the smears; None without translation."""
        if self.pose is not None:
            still = not np.linalg.norm(self.pose.t) > 0
            return None if still else fundamental_from_pose(self.pose.K, self.pose.R, self.pose.t)
        return gold_standard_fundamental(self.ordered_ends())

    def ordered_ends(self) -> AnyArray:
        """Return the ends (N, 2, 2) of the valid smears of every fourth pixel, first then last."""
        smears = self.smears
        rows, columns = np.nonzero(smears.valid[1::4, 1::4])
        middle = np.stack([4 * columns + 1, 4 * rows + 1], axis=1).astype(float)
        half = smears.displacement[1::4, 1::4][rows, columns].astype(float) / 2
        return np.stack([middle - half, middle + half], axis=1)


class Reader(ABC):
    """Exposures of a dataset in order; iterating reads them all."""

    @abstractmethod
    def unread(self) -> Iterator[Callable[[], Exposure]]:
        """Yield for every exposure what reads it, so that those passed over cost nothing."""

    def __iter__(self) -> Iterator[Exposure]:
        """Yield one after another."""
        return (read() for read in self.unread())


def read_frame(path: Path) -> AnyArray:
    """Return a frame (H, W, 3) as uint8 RGB; Blur2ViewError if the file is missing or no picture."""
    encoded = np.fromfile(path, np.uint8) if path.is_file() else np.empty(0, np.uint8)
    picture = cv2.imdecode(encoded, cv2.IMREAD_COLOR) if len(encoded) else None
    if picture is None:
        reason = "is no readable picture" if path.is_file() else "is missing"
        raise Blur2ViewError(f"{path}: {reason}; unpack the dataset again")
    return np.ascontiguousarray(picture[..., ::-1])


def linearised(frame: AnyArray) -> AnyArray:
    """Return sRGB-coded uint8 as linear light: float32, white = 1."""
    return srgb_to_linear(np.arange(256) / 255)[frame]


def coded(linear: AnyArray) -> AnyArray:
    """Return the inverse of :func:`linearised`, rounded to uint8."""
    light = np.clip(linear, 0, 1)
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
    return (255 * curve + 0.5).astype(np.uint8)


def require_folder(folder: Path, what: str) -> Path:
    """Return the folder; Blur2ViewError, saying what should be in it, if there is none."""
    if not folder.is_dir():
        raise Blur2ViewError(f"{folder}: no such folder, {what} expected; see help('tools.datasets')")
    return folder


def numbered(folder: Path, suffixes: tuple[str, ...] = (".png",)) -> dict[int, Path]:
    """Return the pictures of a folder whose names are numbers, by number, in order."""
    found = {int(p.stem): p for p in folder.iterdir() if p.suffix in suffixes and p.stem.isdigit()}
    return dict(sorted(found.items()))
