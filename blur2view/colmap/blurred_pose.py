"""The pose of one blurred photograph, from registered neighbours and the model's points that they see.

A neighbour is warped to where the photograph is expected to be, by the inverse depth of the model's points,
and each of the two is blurred as the other one is (`blur_matching`): by a rigid motion during its exposure,
fit to its smears, and a change of the rotation's rate. What differs between two pictures of equal blur
corrects both (`Kernel`): so the pose is that of mid exposure, from which the blur's centroid is 0.15 degrees
away in frames of RedKitchen with smears of 52 px.
"""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from blur2view.arrays import TINY, Array
from blur2view.camera import to_colmap
from blur2view.colmap.blur_matching import (
    HALF_PATCH,
    SAMPLE_STEP,
    blurred_along,
    gradients,
    match_patches,
    patches,
    resampled,
    same_sense,
)
from blur2view.colmap.exposure_motion import Motion, doubt_of, fit_pose, fit_smears, image_flow, projected
from blur2view.smears.grid import SmearGrid

Mask = NDArray[np.bool_]

CELL = 8  # pixels from one place to the next at which the warp and the blur are computed
NEAREST, SMOOTH_PX = 8, 8.0  # points whose inverse depth is averaged at a place, and how near is near
BORDER_PX = 3.0  # a point must be as far within the picture
LEAST_CORRELATION = 0.8
MOST_WARP_PX = 6.0  # from where a point is in a neighbour to where the smooth depth puts it
ROUNDS = ((0.5, 2), (1.0, 1), (1.0, 0))  # part of the working size, and levels of the tracker's pyramid
FLOOR_PX = 0.3  # standard deviation of a place beside what the patch itself says
KERNEL_PATCHES = 600  # of a neighbour, from which the blur is corrected
KERNEL_DOUBT = 0.3  # standard deviation of a correction of the blur, of its rotation
FEWEST = 6  # points of which a pose is made


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A photograph at the size at which it is worked on."""

    image: Any  # (H, W) float32, grey, linear light
    grid: SmearGrid  # of the photograph in its own size
    camera: Any  # pycolmap.Camera of the working size
    pose: Array  # (3, 4) cam_from_world; of a photograph to be recovered where it is expected

    def smears(self, points: Array) -> tuple[Array, Array]:
        """Return displacements (N, 2) and standard deviations (N,) at pixels (N, 2), of the working size."""
        scale = self.camera.width / self.grid.size[0]
        smears = self.grid.at((points + 0.5) / scale - 0.5)
        return smears.displacement * scale, np.maximum(smears.sigma_px * scale, FLOOR_PX)

    def scaled(self, scale: float) -> "View":
        """Return the view in another size."""
        if scale == 1:
            return self
        size = round(self.camera.width * scale), round(self.camera.height * scale)
        camera = deepcopy(self.camera)
        camera.rescale(*size)
        image = cv2.resize(self.image, size, interpolation=cv2.INTER_AREA)
        return replace(self, image=image, camera=camera)

    def points(self, world: Array) -> Array:
        """Return points (N, 3) of the world in this camera's frame."""
        return np.asarray(world @ self.pose[:, :3].T + self.pose[:, 3])

    def project(self, world: Array) -> Array:
        """Return the pixels (N, 2) of points (N, 3) of the world, NaN of what lies behind."""
        return projected(self.camera, self.points(world))


class BlurredPose(NamedTuple):
    """What neighbours say of a photograph's pose, in pixels of the working size."""

    pose: Array  # (3, 4) cam_from_world at mid exposure
    information: Array  # (6, 6) of a rotation and translation of points in it, as of independent matches
    motion: Motion
    smear_motion: Array  # (6,) the rigid motion by the smears alone
    numbers: NDArray[np.int_]  # (M,) points that were found, each once
    places: Array  # (M, 2) where
    residual_px: float  # median distance of the places from the projections
    tried: int  # points that were looked for


class Lattice:
    """Places every `CELL` pixels of a camera's picture, between which smooth fields are interpolated."""

    def __init__(self, camera: Any) -> None:
        width, height = camera.width, camera.height
        x, y = (np.arange(0, side + CELL, CELL, dtype=float) for side in (width, height))
        self.shape = len(y), len(x)
        self.points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        rays = np.asarray(camera.cam_from_img(to_colmap(self.points)), float)
        self.rays = np.nan_to_num(np.column_stack([rays, np.ones(len(rays))]))
        columns, rows = (np.arange(side, dtype=np.float32) / CELL for side in (width, height))
        self.place = np.dstack(np.meshgrid(columns, rows))

    def everywhere(self, field: Array) -> Any:
        """Return a field (N, C) of the places at all pixels, (H, W, C), float32."""
        return resampled(field.reshape(*self.shape, -1).astype(np.float32), self.place)

    def jacobian(self, field: Array) -> Array:
        """Return the derivatives (N, 2, 2) of a field (N, 2) by x and y."""
        values = field.reshape(*self.shape, 2)
        return np.stack([np.gradient(values, CELL, axis=axis) for axis in (1, 0)], axis=-1).reshape(-1, 2, 2)


def within(camera: Any, pixels: Array) -> Mask:
    """Return which pixels (N, 2) are `BORDER_PX` or more within a camera's picture."""
    last = np.array([camera.width, camera.height]) - 1
    return np.asarray(np.all((pixels > BORDER_PX) & (pixels < last - BORDER_PX), axis=1))


def inverse_depth_at(places: Array, pixels: Array, depth: Array) -> Array:
    """Return smooth inverse depths (N,) at places (N, 2) from depths (M,) of points at pixels (M, 2)."""
    near, index = cKDTree(pixels).query(places, k=min(NEAREST, len(pixels)))
    near, index = near.reshape(len(places), -1), index.reshape(len(places), -1)
    weight = 1 / (near + SMOOTH_PX) ** 2
    return np.asarray((weight / depth[index]).sum(axis=1) / weight.sum(axis=1))


class Kernel:
    """Normal equations of corrections (9,) to a motion and its bend, from what differs between patches.

    To first order a blurred picture changes by the blurred gradients, weighted by t and t^2, times the
    change of path and bend. Of each patch gain and displacement are free; they are projected out.
    """

    def __init__(self) -> None:
        self.normal, self.right = np.zeros((9, 9)), np.zeros(9)

    def add(self, blurred: Sequence[Any], other: Any, points: Array, moved: Array, flow: Array) -> None:
        """Add patches about points (N, 2) of images weighted by 1, t, t^2; the motion's flow is (N, 2, 6)."""
        here, there = patches(blurred[0], points), patches(other, points + moved)
        slope, by_path, by_bend = (patches(gradients(np.ascontiguousarray(one)), points) for one in blurred)
        change = -np.concatenate([by_path @ flow, by_bend @ flow[:, :, :3]], axis=-1)
        free = np.concatenate([here[..., None], slope], axis=-1)
        free /= np.linalg.norm(free, axis=1, keepdims=True) + 1e-6
        basis, _ = np.linalg.qr(free)
        across = np.swapaxes(basis, 1, 2)
        change = change - basis @ (across @ change)
        missed = there - (basis @ (across @ there[..., None]))[..., 0]
        variance = (0.1 * here.std(axis=1)) ** 2 + (missed**2).mean(axis=1) + 1e-6
        weighted = change / (variance * HALF_PATCH / SAMPLE_STEP)[:, None, None]
        self.normal += np.tensordot(weighted, change, ((0, 1), (0, 1)))
        self.right += np.tensordot(weighted, missed, ((0, 1), (0, 1)))

    def corrected(self, motion: Motion, expected: Array) -> Motion:
        """Return a motion after the correction, near itself, with a bend that is small."""
        turned = KERNEL_DOUBT * np.linalg.norm(motion.rigid[:3]) + TINY
        precision = np.repeat([turned, KERNEL_DOUBT * doubt_of(expected), turned], 3) ** -2.0
        right = self.right - precision * np.concatenate([np.zeros(6), motion.bend])
        step = np.linalg.solve(self.normal + np.diag(precision), right)
        return Motion(rigid=motion.rigid + step[:6], bend=motion.bend + step[6:])


def find_pose(
    view: View, neighbours: Sequence[View], world: Array, seen: Sequence[Mask], expected: Array
) -> BlurredPose | None:
    """Return the pose of a photograph that is about where its view is; None where too little is found in it.

    From points (N, 3) of the world, of which each neighbour sees some (N,); ``expected`` (6,) is the change
    of a frame about it.
    """
    pixels = view.project(world)
    inside = within(view.camera, pixels)
    if not inside.any():
        return None
    flow, pose = image_flow(view.camera, view.points(world)[inside]), view.pose
    smear_motion = fit_smears(flow, *view.smears(pixels[inside]), expected)
    motion = Motion(rigid=smear_motion, bend=np.zeros(3))
    for scale, levels in ROUNDS:
        here, there = view.scaled(scale), [one.scaled(scale) for one in neighbours]
        search = Search(replace(here, pose=pose), world)
        if search.inside.sum() < NEAREST:
            return None
        kernel = Kernel() if levels else None  # not in the last round
        index, places, covariance = search.matches(there, seen, motion, levels, kernel)
        if len(np.unique(index)) < FEWEST:
            return None
        pose, information = fit_pose(here.camera, pose, world[index], places, covariance)
        if kernel is not None:
            motion = kernel.corrected(motion, expected)
    index, places = _means(index, places, covariance)
    residual = np.linalg.norm(places - replace(view, pose=pose).project(world[index]), axis=1)
    missed, tried = float(np.median(residual)), int(inside.sum())
    return BlurredPose(pose, information, motion, smear_motion, index, places, missed, tried)


def _means(index: NDArray[np.int_], places: Array, covariance: Array) -> tuple[NDArray[np.int_], Array]:
    """Return each point once, and the mean of its places (M, 2) by their covariances (M, 2, 2)."""
    index, where = np.unique(index, return_inverse=True)
    precision = np.linalg.inv(covariance)
    total, right = np.zeros((len(index), 2, 2)), np.zeros((len(index), 2))
    np.add.at(total, where, precision)
    np.add.at(right, where, (precision @ places[..., None])[..., 0])
    return index, np.asarray(np.linalg.solve(total, right[..., None])[..., 0], float)


class Search:
    """Where points (N, 3) of the model, of which some are ``inside``, are looked for in a photograph."""

    def __init__(self, view: View, world: Array) -> None:
        self.view, self.world, self.lattice = view, world, Lattice(view.camera)
        self.points = view.points(world)
        self.pixels = projected(view.camera, self.points)
        self.inside = within(view.camera, self.pixels)

    def matches(
        self,
        neighbours: Sequence[View],
        seen: Sequence[Mask],
        motion: Motion,
        levels: int,
        kernel: Kernel | None,
    ) -> tuple[NDArray[np.int_], Array, Array]:
        """Return points found (M,), places (M, 2), covariances (M, 2, 2); add what patches differ by."""
        seen_pixels, seen_depth = self.pixels[self.inside], self.points[self.inside, 2]
        depth = 1 / inverse_depth_at(self.lattice.points, seen_pixels, seen_depth)
        surface = self.lattice.rays * depth[:, None]  # (L, 3), smooth, in the camera
        flow = image_flow(self.view.camera, surface)
        path, bend = flow @ motion.rigid, flow[:, :, :3] @ motion.bend
        warps = [self._warp(one, surface, path) for one in neighbours]
        scene = np.dstack([one[0] for one in warps])
        fields = self.lattice.everywhere(path), self.lattice.everywhere(bend) if motion.bend.any() else None
        blurred = blurred_along(scene, *fields, moments=kernel is not None)
        found = []
        for number, (neighbour, (_, where, smears)) in enumerate(zip(neighbours, warps, strict=True)):
            index = np.flatnonzero(self.inside & seen[number])
            pixels = self.pixels[index]
            warped = resampled(where, np.asarray(pixels, np.float32)[:, None])[:, 0]
            there = neighbour.project(self.world[index]) - warped
            pictures = [np.ascontiguousarray(one[..., number]) for one in blurred]
            other = blurred_along(self.view.image, smears)[0]
            match = match_patches(pictures[0], other, pixels, levels)
            near: Mask = np.linalg.norm(there, axis=1) < MOST_WARP_PX  # False of NaN
            good = match.found & near & (match.correlation > LEAST_CORRELATION)
            found.append((index[good], (pixels + match.moved + there)[good], match.covariance[good]))
            if kernel is not None and good.any():
                best = np.flatnonzero(good)
                best = best[:: 1 + len(best) // KERNEL_PATCHES]
                moves = image_flow(self.view.camera, self.view.points(self.world[index[best]]))
                kernel.add(pictures, other, pixels[best], match.moved[best], moves)
        index, places, covariance = (np.concatenate(one) for one in zip(*found, strict=True))
        return index, places, covariance + FLOOR_PX**2 * np.eye(2)

    def _warp(self, neighbour: View, surface: Array, path: Array) -> tuple[Any, Any, Any]:
        """Return a neighbour's picture where this one's is, where that is in it, and its smears here."""
        there, here = neighbour.pose, self.view.pose
        R = there[:, :3] @ here[:, :3].T
        t = there[:, 3] - R @ here[:, 3]
        where = np.nan_to_num(projected(neighbour.camera, surface @ R.T + t), nan=-1e3)
        jacobian = self.lattice.jacobian(where) + 1e-6 * np.eye(2)
        smears = np.asarray(np.linalg.solve(jacobian, neighbour.smears(where)[0][..., None])[..., 0], float)
        field = self.lattice.everywhere(same_sense(smears, path))
        pixels = self.lattice.everywhere(where)
        return resampled(neighbour.image, pixels, cv2.INTER_CUBIC), pixels, field
