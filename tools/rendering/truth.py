"""The truth of one exposure: displacement, bend, validity and labels on the grid; pose and F of the image."""

from dataclasses import dataclass

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from tools.rendering.canvas import Canvas
from tools.rendering.exposure import Exposure, grid_points, pixel_grid, upsample
from tools.rendering.motion import Trajectory

CROSS_CHECK_PX = 1.0  # largest disagreement of a smear's end with what is visible there (the paper's eps)


@dataclass(frozen=True, kw_only=True)
class SceneTruth:
    """The truth of one exposure; of the points seen at mid exposure at the centres of 4 x 4 pixel cells.

    ``displacement`` (H/4, W/4, 2) is d = close - open in pixels, exact. ``valid``: both ends are inside the
    image and visible (the cross-check map). ``static`` is false on moving objects. ``K`` are the intrinsics,
    ``R``, ``t`` is ``cam_close_from_cam_open``, ``F`` of unit norm, ``points_close^T F points_open = 0``,
    None without translation. ``kind`` is that of the camera's path
    (`tools.rendering.motion.sample_camera_path`).
    """

    displacement: AnyArray
    valid: AnyArray
    static: AnyArray
    K: AnyArray
    R: AnyArray
    t: AnyArray
    F: AnyArray | None
    kind: str

    @property
    def median_px(self) -> float:
        """The median length of valid smears."""
        return float(np.median(np.linalg.norm(self.displacement[self.valid], axis=-1)))


def origin_map(canvases: list[Canvas], fields: list[AnyArray], size: tuple[int, int]) -> AnyArray:
    """Return the mid-exposure position (H, W, 2) of what is visible at each pixel of one sub-frame."""
    pixels = pixel_grid(size)
    origin = pixels.copy()
    for canvas, coarse in zip(canvases, fields, strict=True):
        positions = pixels + upsample(coarse, size)
        visible = canvas.warp(positions)[..., 3] > 0.5
        origin[visible] = positions[visible]
    return origin


def end_visible(origin: AnyArray, end: AnyArray, points: AnyArray, size: tuple[int, int]) -> AnyArray:
    """Whether the smear's end shows the point itself: inside the image and cross-checked."""
    at = end.astype(np.float32)
    columns, rows = at[..., 0], at[..., 1]
    seen = np.asarray(cv2.remap(origin, columns, rows, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE))
    inside = ((end >= 0) & (end <= np.array(size) - 1)).all(-1)
    return np.asarray(inside & (np.linalg.norm(seen - points, axis=-1) < CROSS_CHECK_PX))


def grid_truth(canvases: list[Canvas], fields: list[AnyArray], exposure: Exposure) -> dict[str, AnyArray]:
    """Return the truth on the grid from the geometry: displacement, valid, static and ``middle_offset``.

    This is the midpoint of both ends minus the mid-exposure position; ``fields`` holds every layer's inverse
    displacements per knot.
    """
    size = exposure.size
    points = grid_points(size)
    index = np.zeros(points.shape[:2], np.int64)  # of the layer that is seen at mid exposure
    for k, canvas in enumerate(canvases[1:], 1):
        index[canvas.warp(points.astype(np.float32))[..., 3] > 0.5] = k
    start, close = np.zeros_like(points), np.zeros_like(points)
    for k, canvas in enumerate(canvases):
        seen = index == k
        for end, positions in zip((start, close), exposure.ends(points, canvas.layer), strict=True):
            end[seen] = positions[seen]
    first = origin_map(canvases, [f[0] for f in fields], size)
    last = origin_map(canvases, [f[-1] for f in fields], size)
    return {
        "displacement": (close - start).astype(np.float32),
        "valid": end_visible(first, start, points, size) & end_visible(last, close, points, size),
        "static": np.array([canvas.layer.own_path is None for canvas in canvases])[index],
        "middle_offset": ((close + start) / 2 - points).astype(np.float32),
    }


def relative_pose(camera: Trajectory) -> tuple[AnyArray, AnyArray]:
    """Return R (3, 3) and t (3,) of ``cam_close_from_cam_open``."""
    (R_open, C_open), (R_close, C_close) = camera.at(-0.5), camera.at(0.5)
    return R_close @ R_open.T, R_close @ (C_open - C_close)
