"""The smears of one image as a robust problem: normalised coordinates and standard deviations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.camera.camera import Camera
from blur2view.geometry.epipolar import denormalise
from blur2view.robust.parametrization import CameraPrior
from blur2view.robust.residuals import WeightedEnds
from blur2view.smears.noise import INDEPENDENT, LENGTH_ERROR, SharedErrors

# Focal length over the longer side of the image. Any value from 0.4 to 0.6 does as well on 35 rendered scenes
# (focal lengths of 0.6 to 1.6) and 34 frames of RedKitchen (0.82); 0.85 and 1.2 raise the mean rho of both by
# a sixth and by more than half. A short lens separates rotation and translation by curved fields, a long one
# hardly, and then errors do; rolling shutters bend fields the same way. Not even the true focal length in its
# place does better (mean rho 0.069, 0.057 and 0.105 on 60 and 40 rendered scenes and RedKitchen, with this
# 0.067, 0.052 and 0.074), so that EXIF's is not asked.
ASSUMED_FOCAL = 0.55
# prior of the rotation: smear length over focal length; roll moves points less
ROTATION_SPREAD = np.array([1.0, 1.0, 3.0])
OUTLIER_ODDS = 0.5  # of a smear; an outlier's residual is uniform between -+ its length / sqrt(2)
ROUGH_COUNT = 350  # smears, at least, that rough fits and the scale of the noise are taken from
LEAST_INDEPENDENT = 100.0  # smears whose residuals measure the noise


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearProblem:
    """Smears in shared normalised coordinates with the standard deviation of their Sampson distance."""

    ends: Array  # (N, 2, 2) under T
    stated_px: Array  # (N,) standard deviation of the Sampson distance, as stated
    T: Array  # (3, 3) pixels to normalised: the inverse of the assumed camera if the image's size is known
    has_camera: bool  # whether T is that of a camera, assumed from the image's size or given
    shared: SharedErrors = INDEPENDENT  # what the errors have in common
    # standard deviations of the log focal length and of the principal point in focal lengths; 0: known
    lens: tuple[float, float] = (CameraPrior.log_focal, CameraPrior.principal)
    scale: float = 1.0  # of the standard deviations, over those stated

    @cached_property
    def sigma_px(self) -> Array:
        """Standard deviations (N,) of the Sampson distance in pixels."""
        return self.stated_px * self.scale

    @property
    def unit_px(self) -> float:
        """Pixels per normalised unit."""
        return float((self.T[0, 0] * self.T[1, 1]) ** -0.5)

    @property
    def intrinsics_known(self) -> bool:
        """Whether the intrinsics are known."""
        return self.lens == (0.0, 0.0)

    @property
    def data_weight(self) -> float:
        """Share of the smears that counts as independent."""
        return self.shared.independent_share

    @property
    def independent(self) -> float:
        """Effective number of independent smears."""
        return self.data_weight * len(self.ends)

    @cached_property
    def weighted(self) -> WeightedEnds:
        """The smears as `refine` wants them."""
        along_px = np.hypot(2**0.5 * self.sigma_px, LENGTH_ERROR * self.length_px)
        return WeightedEnds(
            ends=self.ends,
            sigma=self.sigma_px / self.unit_px,
            along=along_px / self.unit_px,
            chance=OUTLIER_ODDS * np.minimum(np.pi**0.5 * self.sigma_px / (self.length_px + TINY), 1),
        )

    @cached_property
    def middle(self) -> Array:
        """Midpoints (N, 2) of the ends."""
        middle: Array = self.ends.mean(axis=1)
        return middle

    @cached_property
    def length_px(self) -> Array:
        """Lengths (N,) in pixels."""
        length: Array = np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=-1) * self.unit_px
        return length

    @cached_property
    def prior(self) -> CameraPrior:
        """What an ordinary camera does while smears of this length arise."""
        x, y, z = ROTATION_SPREAD * float(np.median(self.length_px)) / self.unit_px
        return CameraPrior(rotation=(x, y, z), log_focal=self.lens[0], principal=self.lens[1])

    @property
    def noise_scale(self) -> float:
        """Scale of the stated deviations: as measured by what F leaves, where many smears are independent.

        Where few are, F takes up errors that neighbours share, and what it leaves is less than they are.
        """
        return self.scale if self.independent >= LEAST_INDEPENDENT else 1.0

    def rescaled(self, factor: float) -> SmearProblem:
        """Return the problem with all standard deviations multiplied by a factor."""
        return replace(self, scale=self.scale * factor)

    def subset(self, index: NDArray[np.int_] | slice) -> SmearProblem:
        """Return the problem of some smears; the share of independent ones stays."""
        return replace(self, ends=self.ends[index], stated_px=self.stated_px[index])

    @cached_property
    def thinned(self) -> SmearProblem:
        """ROUGH_COUNT of the smears or up to twice as many, evenly."""
        return self.subset(slice(None, None, max(1, len(self.ends) // ROUGH_COUNT)))

    def pixels(self, F: Array) -> Array:
        """Return F of pixel coordinates, unit norm, from F of normalised ones."""
        return denormalise(F, self.T)


def assumed_camera(image_size: tuple[float, float]) -> Array:
    """Return K^-1 (3, 3) of the assumed camera: centred, focal length ASSUMED_FOCAL times the longer side."""
    width, height = image_size
    focal = ASSUMED_FOCAL * max(width, height)
    return np.array(
        [[1 / focal, 0, -(width - 1) / 2 / focal], [0, 1 / focal, -(height - 1) / 2 / focal], [0, 0, 1]]
    )


def build_problem(
    ends: Array,
    sigma_px: Array,
    image_size: tuple[int, int] | None,
    camera: Camera | None = None,
    shared: SharedErrors = INDEPENDENT,
) -> SmearProblem:
    """Return smears (N, 2, 2) normalised; sigma_px (N,) is that of the Sampson distance, pixels.

    Coordinates are those of the camera, for whose undistorted pixels the ends are given, else of an assumed
    one; without an image size that of an image which just holds the ends, of which nothing is assumed.
    """
    if camera is not None:
        T: Array = np.asarray(np.linalg.inv(camera.K), float)
    elif image_size is not None:
        T = assumed_camera(image_size)
    else:
        low, high = ends.min(axis=(0, 1)), ends.max(axis=(0, 1))
        width, height = high - low + 1
        T = assumed_camera((width, height))
        T[:2, 2] -= T[0, 0] * low
    problem = SmearProblem(
        ends=ends * np.diag(T)[:2] + T[:2, 2],
        stated_px=sigma_px,
        T=T,
        has_camera=camera is not None or image_size is not None,
        shared=shared,
    )
    if camera is None:
        return problem
    return replace(problem, lens=(camera.log_focal_sigma, 0.0 if camera.known else CameraPrior.principal))
