"""SceneFlow's Monkaa and Driving: rendered frames with flow both ways and cameras.

One exposure runs from a frame to the next. Both datasets, unpacked, hold (Monkaa's scenes are folders such as
``eating_x2``, Driving's ``15mm_focallength/scene_forwards/fast`` and so on)::

    frames_cleanpass/SCENE/left/0000.png            or frames_finalpass, or ..._webp with .webp
    optical_flow/SCENE/into_future/left/OpticalFlowIntoFuture_0000_L.pfm
    optical_flow/SCENE/into_past/left/OpticalFlowIntoPast_0000_L.pfm
    camera_data/SCENE/camera_data.txt

and the same for ``right``, ``R``. Frames are numbered from 0 (Monkaa) or 1 (Driving).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.errors import Blur2ViewError
from tools.datasets.exposure import Exposure, Pose, Reader, linearised, numbered, read_frame, require_folder
from tools.datasets.flow import averaged, mid_smears, sub_frames

SENSOR_MM, USUAL_FOCAL_MM = 32.0, 35.0
"""Blender's sensor width; the focal length where no folder names another: 1050 px at 960 px."""
SIDES = {"left": "L", "right": "R"}
PASSES = ("clean", "final")
FLIP: AnyArray = np.diag([1.0, -1.0, -1.0])
"""Blender's camera looks along -z with y up, ours along z with y down."""


def read_pfm(path: Path) -> AnyArray:
    """Return a PFM file as float32 (H, W, 3) or (H, W), first row on top.

    Blur2ViewError if the file is missing, no PFM or cut short.

    References
    ----------
    Debevec, PFM Portable FloatMap: rows from the bottom up, little-endian if the scale is negative.
    """
    if not path.is_file():
        raise Blur2ViewError(f"{path}: is missing; unpack optical_flow again")
    content = path.read_bytes()
    head = re.match(rb"(PF|Pf)\s+(\d+)\s+(\d+)\s+([-+.\deE]+)\s", content)
    if head is None:
        raise Blur2ViewError(f"{path}: is no PFM file; unpack optical_flow again")
    kind, width, height, scale = head[1], int(head[2]), int(head[3]), float(head[4])
    shape = (height, width, 3) if kind == b"PF" else (height, width)
    if len(content) - head.end() != 4 * int(np.prod(shape)):
        raise Blur2ViewError(f"{path}: is cut short or too long; unpack optical_flow again")
    values = np.frombuffer(content, "<f4" if scale < 0 else ">f4", offset=head.end())
    return values.reshape(shape)[::-1].astype(np.float32)


def read_cameras(path: Path, side: str) -> dict[int, AnyArray]:
    """Return, by frame, the camera-to-world matrix (4, 4) of one side of camera_data.txt, in Blender's axes.

    Every frame has three lines, ``Frame 7``, ``L`` and ``R``, the latter with 16 numbers, row by row.
    """
    if not path.is_file():
        raise Blur2ViewError(f"{path}: is missing; unpack camera_data")
    cameras: dict[int, AnyArray] = {}
    frame = None
    for number, line in enumerate(path.read_text().splitlines(), 1):
        words = line.split()
        try:
            if words and words[0] == "Frame":
                frame = int(words[1])
            elif words and words[0] == SIDES[side] and frame is not None:
                cameras[frame] = np.array(words[1:], float).reshape(4, 4)
        except (ValueError, IndexError):
            raise Blur2ViewError(f"{path}, line {number}: cannot be read; unpack camera_data again") from None
    if not cameras:
        raise Blur2ViewError(f"{path}: holds no camera of the {side} side; unpack camera_data again")
    return cameras


def relative_pose(first: AnyArray, last: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return R and t of ``cam_last_from_cam_first``, in our axes, from two camera-to-world matrices."""
    moved = np.linalg.inv(last) @ first
    return FLIP @ moved[:3, :3] @ FLIP, FLIP @ moved[:3, 3]


def intrinsics(scene: str, size: tuple[int, int]) -> AnyArray:
    """Return K of pictures of a size (width, height); a folder like ``15mm_focallength`` names the lens."""
    named = re.search(r"(\d+)mm_focallength", scene)
    focal = (float(named[1]) if named else USUAL_FOCAL_MM) / SENSOR_MM * size[0]
    return np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1.0]])


class SceneFlow(Reader):
    """Every exposure of one side of Monkaa or Driving.

    Parameters
    ----------
    root : Path
        The folder that holds ``frames_...pass``, ``optical_flow`` and ``camera_data``.
    side : {"left", "right"}
    render_pass : {"clean", "final"}
        The final pass has motion blur and defocus of its own.

    Raises
    ------
    Blur2ViewError
        If a folder is missing or holds no scene; on iteration, if a file of an exposure is missing or broken.
    """

    def __init__(self, root: Path, side: str = "left", render_pass: str = "clean") -> None:
        if side not in SIDES or render_pass not in PASSES:
            raise ValueError(f"side must be of {list(SIDES)}, render_pass of {PASSES}")
        self.root, self.side = require_folder(root, "SceneFlow's Monkaa or Driving"), side
        plain = root / f"frames_{render_pass}pass"
        webp = plain.with_name(f"{plain.name}_webp")
        self.frames = webp if webp.is_dir() and not plain.is_dir() else require_folder(plain, "frames")
        for name in ("optical_flow", "camera_data"):
            require_folder(root / name, "which the dataset has as a download of its own,")
        self.scenes = sorted(str(p.parent.relative_to(self.frames)) for p in self.frames.rglob(side))
        if not self.scenes:
            raise Blur2ViewError(f"{self.frames}: holds no folder {side}; unpack the frames again")

    def unread(self) -> Iterator[Callable[[], Exposure]]:
        """Yield what reads the exposures, scene by scene."""
        for scene in self.scenes:
            yield from self.exposures(scene)

    def exposures(self, scene: str) -> Iterator[Callable[[], Exposure]]:
        """Yield what reads the exposures of one scene, between frames whose numbers follow each other."""
        frames = numbered(self.frames / scene / self.side, (".png", ".webp"))
        cameras = read_cameras(self.root / "camera_data" / scene / "camera_data.txt", self.side)
        for number, path in frames.items():
            if number + 1 in frames:
                yield partial(self.exposure, scene, number, path, frames[number + 1], cameras)

    def exposure(
        self, scene: str, number: int, path: Path, next_path: Path, cameras: dict[int, AnyArray]
    ) -> Exposure:
        """Return the exposure of two frames and what lies between them, blurred."""
        if number not in cameras or number + 1 not in cameras:
            where = self.root / "camera_data" / scene / "camera_data.txt"
            raise Blur2ViewError(f"{where}: lacks frame {number} or {number + 1}; unpack camera_data again")
        first, last = read_frame(path), read_frame(next_path)
        forward, backward = self.flow(scene, "Future", number), self.flow(scene, "Past", number + 1)
        if not first.shape[:2] == last.shape[:2] == forward.shape[:2] == backward.shape[:2]:
            raise Blur2ViewError(f"{path}: differs in size from its flow; unpack the dataset again")
        smears = mid_smears(forward, backward)
        count = sub_frames(smears.displacement, smears.valid)
        R, t = relative_pose(cameras[number], cameras[number + 1])
        K = intrinsics(scene, (first.shape[1], first.shape[0]))
        return Exposure(
            name=f"{scene.replace('/', '_')}_{self.side}_{number:04d}",
            linear=averaged(linearised(first), linearised(last), forward, backward, count),
            first=first,
            last=last,
            smears=smears,
            pose=Pose(K=K, R=R, t=t),
        )

    def flow(self, scene: str, time: str, number: int) -> AnyArray:
        """Return the flow of a frame into the "Future" or "Past", (H, W, 2); its third channel is empty."""
        folder = self.root / "optical_flow" / scene / f"into_{time.lower()}" / self.side
        values = read_pfm(folder / f"OpticalFlowInto{time}_{number:04d}_{SIDES[self.side]}.pfm")
        if values.ndim != 3:
            raise Blur2ViewError(f"{folder}: frame {number} has one channel; is it disparity?")
        return np.ascontiguousarray(np.nan_to_num(values[..., :2], posinf=0, neginf=0))
