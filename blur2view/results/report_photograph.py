"""What the report's page shows of one photograph: its picture, its smears and its estimate, as JSON."""

from dataclasses import replace
from typing import TypedDict

import numpy as np

from blur2view.camera.camera import Camera
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.pipeline import FileEstimate
from blur2view.results.estimate import EstimateDocument
from blur2view.results.mask_overlay import headline
from blur2view.results.report_pack import Packed, packed, picture
from blur2view.results.verdicts import kind, meaning
from blur2view.segmentation.mask import MotionMask
from blur2view.smears.grid import SmearGrid
from blur2view.smears.matches import SmearMatches
from blur2view.smears.selection import cells_apart

NODE_PX = 4  # distance of the nodes at which smears are shown, at least
MAX_NODES = 150_000  # of the grid of smears
SMEAR_STEP_PX = 1 / 64
DIRECTION_STEP_RAD = 2**-12  # 0.014 degrees
LENS_NODE_PX = 16  # bilinear between nodes: a few hundredths of a pixel for ordinary lenses
LENS_STEP_PX = 2**-10


class Grid(TypedDict):
    """Smears at the nodes of a grid, which starts at (x0, y0); the sigmas in pixels and in radians."""

    x0: int
    y0: int
    step_px: int
    displacement: Packed
    sigma_px: Packed
    sigma_rad: Packed


class Matches(TypedDict):
    """The smears that were used: x0, y0, x1, y1 of their ends, and flags 1 inlier, 2 swapped.

    Each is that of the square of side ``spacing_px`` about its middle.
    """

    spacing_px: int
    ends: Packed
    flags: Packed


class Lens(TypedDict):
    """Where pixels would lie without distortion, less where they lie, at the nodes of a grid."""

    step_px: int
    shift: Packed


class Motion(TypedDict):
    """A motion mask: labels at every k-th pixel, probability at the nodes of the grid of smears; words."""

    labels: Packed
    every_px: int
    probability: Packed
    headline: str
    reason: str


class PhotographRecord(TypedDict):
    """What the page shows of one photograph.

    ``picture`` is a data URI, ``kind`` and ``meaning`` are of `verdicts`, ``median_px`` is the
    median length of the smears that were used, ``document`` the text of the JSON document of ``blur2view
    estimate``, ``seconds`` the time of every step.
    """

    name: str
    width: int
    height: int
    picture: str
    kind: str
    meaning: str
    median_px: float | None
    document: str
    grid: Grid
    matches: Matches
    lens: Lens | None
    mask: Motion | None
    seconds: dict[str, float] | None


def photograph(
    one: FileEstimate, mask: MotionMask | None = None, mask_s: float | None = None, *, timings: bool = True
) -> PhotographRecord:
    """Return everything the page shows of one photograph, in JSON's types.

    Without a mask its layers are left out; ``mask_s`` are the seconds that it took. Without timings equal
    photographs have equal texts: the ``timings_s`` of the document are null.
    """
    estimate, geometry = one.estimate, one.estimate.geometry
    document = EstimateDocument.of(one)
    seconds = one.timings_s | ({} if mask_s is None else {"mask": mask_s})
    height, width = estimate.grid.shape
    spacing_px = estimate.grid.stride * cells_apart(estimate.grid, one.run.select)
    return {
        "name": str(one.path),
        "width": width,
        "height": height,
        "picture": picture(one.image),
        "kind": kind(geometry),
        "meaning": meaning(one),
        "median_px": median_length(estimate.matches),
        "document": (document if timings else replace(document, timings_s=None)).to_json(),
        "grid": nodes(estimate.grid),
        "matches": matches(estimate.matches, geometry, spacing_px),
        "lens": lens(estimate.camera),
        "mask": None if mask is None else motion(mask),
        "seconds": seconds if timings else None,
    }


def median_length(used: SmearMatches) -> float | None:
    """Return the median length of the smears that were used, pixels; None without any."""
    return float(np.median(used.length_px)) if len(used) else None


def node_pixels(shape: tuple[int, int]) -> tuple[slice, slice]:
    """Return rows and columns of the pixels that are shown: every fourth, or more apart."""
    height, width = shape
    nodes = -(-height // NODE_PX) * -(-width // NODE_PX)
    step = NODE_PX * int(np.ceil(np.sqrt(nodes / MAX_NODES)))
    return slice(min(1, height - 1), None, step), slice(min(1, width - 1), None, step)


def nodes(grid: SmearGrid) -> Grid:
    """Return the smears at the nodes that are shown and their sigmas, packed."""
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


def matches(used: SmearMatches, geometry: TwoViewGeometry, spacing_px: int) -> Matches:
    """Return the smears that were used, one every ``spacing_px`` pixels, packed."""
    flags = geometry.inlier_mask.astype(np.uint8) + 2 * geometry.swapped.astype(np.uint8)
    return {
        "spacing_px": spacing_px,
        "ends": packed(used.ends.reshape(-1, 4).T, "int32", SMEAR_STEP_PX),
        "flags": packed(flags, "uint8"),
    }


def lens(camera: Camera | None) -> Lens | None:
    """Return where a camera's pixels would lie without distortion, on a grid, packed; None without any.

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


def motion(mask: MotionMask) -> Motion:
    """Return a motion mask, packed: labels at every k-th pixel, probability at the nodes of the grid."""
    rows, columns = node_pixels(mask.labels.shape)
    every = max(rows.step // NODE_PX, 1)
    return {
        "labels": packed(mask.labels[::every, ::every], "uint8"),
        "every_px": every,
        "probability": packed(np.clip(mask.probability[rows, columns], 0, 1), "uint8", 1 / 255),
        "headline": headline(mask),
        "reason": mask.reason,
    }
