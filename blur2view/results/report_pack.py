"""What the report's page shows of one photograph: its picture, its smears and its estimate, as JSON.

Arrays are text that an HTML page can carry: quantised, delta-coded, deflated, base64.
"""

import base64
import zlib
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from blur2view.arrays import AnyArray
from blur2view.camera.camera import Camera
from blur2view.pipeline import FileEstimate
from blur2view.results.drawing import View
from blur2view.results.estimate import EstimateDocument
from blur2view.results.mask_overlay import mask_verdict
from blur2view.results.overlay import circles
from blur2view.results.verdicts import kind, verdict_of
from blur2view.segmentation.mask import MotionMask
from blur2view.smears.grid import SmearGrid
from blur2view.smears.selection import cells_apart

PICTURE_SIDE_PX = 2048  # the longer side of an embedded photograph at most: Full HD stays as it is
PICTURE_QUALITY, THUMBNAIL_QUALITY = 90, 80  # of JPEG; a 1280x720 street has 160 kB at 90
THUMBNAIL_SIDE_PX = 400
NODE_PX = 4  # distance of the nodes at which smears are shown, at least
MAX_NODES = 150_000  # of the grid of smears
SMEAR_STEP_PX = 1 / 64
CIRCLE_STEP_PX = 1 / 16
DIRECTION_STEP_RAD = 2**-12  # 0.014 degrees
LENS_NODE_PX = 16  # bilinear between nodes: a few hundredths of a pixel for ordinary lenses
LENS_STEP_PX = 2**-10
Json = dict[str, Any]


def photograph(one: FileEstimate, mask: MotionMask | None = None, mask_s: float | None = None) -> Json:
    """Return everything the page shows of one photograph.

    Among it are ``picture``, a data URI; ``median_px``, the median length of the smears that were used, None
    without any; ``document``, the text of the JSON document of ``blur2view estimate``; ``matches``, the
    smears that were used as x0, y0, x1, y1 of their ends with flags 1 inlier, 2 swapped, each that of the
    square of side ``spacing_px`` about its middle. Without a mask its layers are left out; ``mask_s`` are the
    seconds that it took.
    """
    estimate, geometry, used = one.estimate, one.estimate.geometry, one.estimate.matches
    height, width = estimate.grid.shape
    flags = geometry.inlier_mask.astype(np.uint8) + 2 * geometry.swapped.astype(np.uint8)
    return {
        "name": str(one.path),
        "width": width,
        "height": height,
        "picture": picture(one.image),
        "kind": kind(geometry),
        "meaning": verdict_of(one),
        "median_px": float(np.median(used.length_px)) if len(used) else None,
        "document": EstimateDocument.of(one).to_json(),
        "grid": nodes(estimate.grid),
        "circles": packed(circles(estimate.grid).T, "uint16", CIRCLE_STEP_PX),
        "matches": {
            "spacing_px": estimate.grid.stride * cells_apart(estimate.grid, one.run.select),
            "ends": packed(used.ends.reshape(-1, 4).T, "int32", SMEAR_STEP_PX),
            "flags": packed(flags, "uint8"),
        },
        "lens": lens(estimate.camera),
        "mask": None if mask is None else motion(mask),
        "seconds": one.timings_s and one.timings_s | ({} if mask_s is None else {"mask": mask_s}),
    }


def node_pixels(shape: tuple[int, int]) -> tuple[slice, slice]:
    """Return rows and columns of the pixels that are shown: every fourth, or more apart."""
    height, width = shape
    nodes = -(-height // NODE_PX) * -(-width // NODE_PX)
    step = NODE_PX * int(np.ceil(np.sqrt(nodes / MAX_NODES)))
    return slice(min(1, height - 1), None, step), slice(min(1, width - 1), None, step)


def nodes(grid: SmearGrid) -> Json:
    """Return the smears at nodes every ``step_px`` from (x0, y0), with their sigmas in pixels and radians."""
    rows, columns = node_pixels(grid.shape)
    y, x = np.arange(grid.shape[0])[rows], np.arange(grid.shape[1])[columns]
    smears = grid.at(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2).astype(float))
    shape = len(y), len(x)
    displacement = smears.displacement.reshape(*shape, 2).transpose(2, 0, 1)
    return {
        "x0": columns.start,
        "y0": rows.start,
        "step_px": rows.step,
        "displacement": packed(displacement, "int16", SMEAR_STEP_PX),
        "sigma_px": packed(smears.sigma_px.reshape(shape), "uint16", SMEAR_STEP_PX),
        "sigma_rad": packed(smears.sigma_rad.reshape(shape), "uint16", DIRECTION_STEP_RAD),
    }


def lens(camera: Camera | None) -> Json | None:
    """Return where pixels would lie without distortion, less where they lie, at nodes; None without any.

    F and H hold for undistorted pixels, so that epipolar lines are curves in the photograph.
    """
    if camera is None or not camera.distorted:
        return None
    columns, rows = (
        np.arange(0, side + LENS_NODE_PX, LENS_NODE_PX) for side in (camera.width, camera.height)
    )
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).astype(np.float64)
    straight = camera.undistorted(pixels)
    moved = np.where(np.isfinite(straight), straight, pixels) - pixels
    return {"step_px": LENS_NODE_PX, "shift": packed(moved.transpose(2, 0, 1), "int32", LENS_STEP_PX)}


def motion(mask: MotionMask) -> Json:
    """Return a motion mask: labels at every k-th pixel, probability at the nodes of smears, and words."""
    rows, columns = node_pixels(mask.labels.shape)
    every = max(rows.step // NODE_PX, 1)
    return {
        "labels": packed(mask.labels[::every, ::every], "uint8"),
        "every_px": every,
        "probability": packed(np.clip(mask.probability[rows, columns], 0, 1), "uint8", 1 / 255),
        "headline": mask_verdict(mask),
        "reason": mask.reason,
    }


def packed(values: NDArray[Any], kind: str, step: float = 1.0) -> Json:
    """Return an array of finite numbers as integers of a type: ``value / step``, rounded, in base64.

    Differences along the last axis, modulo the type's range, are split into planes of bytes, low bytes first,
    deflated and written in base64; ``report_page/unpack.js`` is the inverse. ``kind`` is "uint8", "int16",
    "uint16" or "int32"; ``step``, what one stands for, is doubled until the type holds every value.
    ValueError if one is not finite, or negative where the type is unsigned.
    """
    values = np.asarray(values)
    if not np.isfinite(values).all():
        raise ValueError("only finite values can be packed")
    limits = np.iinfo(kind)
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    if low < 0 and limits.min == 0:
        raise ValueError(f"{kind} holds no negative values, got {low}")
    while high / step > limits.max or low / step < limits.min:
        step *= 2
    integers = np.round(values / step).astype(f"<{np.dtype(kind).str[1:]}")
    deltas = integers.copy()
    deltas[..., 1:] -= integers[..., :-1]  # wraps around, as the sums on the page do
    planes = deltas.view(np.uint8).reshape(-1, integers.dtype.itemsize).T
    data = zlib.compress(planes.tobytes(), 6)  # 9: 25 times as long, 0.5 % less
    shape = list(integers.shape)
    return {"type": kind, "shape": shape, "step": step, "data": base64.b64encode(data).decode()}


def picture(image: AnyArray, side_px: int = PICTURE_SIDE_PX, quality: int = PICTURE_QUALITY) -> str:
    """Return a photograph (H, W, 3), of 8 or 16 bits or in [0, 1], as the data URI of a JPEG of this side."""
    levels = View.of(image.shape, min(side_px, max(image.shape[:2]))).picture(image)
    file = BytesIO()
    Image.fromarray(levels).save(file, "JPEG", quality=quality, subsampling=0)
    return "data:image/jpeg;base64," + base64.b64encode(file.getvalue()).decode()
