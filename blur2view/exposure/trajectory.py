"""The motion of a camera during exposures whose place in a trajectory is known.

Where a reconstruction holds the photographs of a video, two things are known beside the smears: how far away
every feature is, which makes its smear linear in the camera's rotation and translation; and how the camera
moves from frame to frame, of which the exposure is a fraction, the same in every frame. So the smears measure
that fraction, and where this frame's motion departs from it. Both are weighted: errors of smears are
correlated and large relative to their length; a trajectory's errors are its curvature and the noise of its
poses, both measured from itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_smoothing_spline

from blur2view.arrays import TINY, Array
from blur2view.geometry.rotation import rotation_flow, rotation_vector
from blur2view.robust.reweighted import reweighted_motion

INDEPENDENT_SMEARS = 30  # smears at most: a network's errors are correlated over much of a picture
MIN_SMEARS = 8  # smears; with fewer a frame's motion is not estimated
STEPS = 5  # of reweighting
MIN_SPLINE = 5  # velocities; fewer are left as they are, which a smoothing spline needs
ROUGHNESS = 2 / 3  # a difference from the mean of two neighbours has 3/2 of one's variance, if all are equal


@dataclass(frozen=True, kw_only=True, eq=False)
class ExposedFrame:
    """A frame's smears at features of known depth, and the trajectory's velocity there, in checked shapes."""

    rays: Array  # (N, 2): x/z, y/z of the features at mid exposure
    displacement: Array  # (N, 2): their smears, open to close, in the same coordinates
    inverse_depth: Array  # (N,): one over the features' z
    # (6,): rotation vector and translation per frame, of cam_later_from_cam_earlier; None without neighbours
    velocity: Array | None

    def __post_init__(self) -> None:
        count = len(self.inverse_depth)
        shapes = self.rays.shape, self.displacement.shape, self.inverse_depth.shape
        if shapes != ((count, 2), (count, 2), (count,)):
            raise ValueError(f"expected rays (N, 2), displacement (N, 2), inverse_depth (N,), got {shapes}")
        if self.velocity is not None and self.velocity.shape != (6,):
            raise ValueError(f"expected a velocity (6,), got {self.velocity.shape}")

    @property
    def rows(self) -> Array:
        """Return the Jacobian (N, 2, 6) of the features by rotation vector and translation."""
        rotation = rotation_flow(self.rays).transpose(2, 0, 1)
        x, y = self.rays.T
        one, none = np.ones_like(x), np.zeros_like(x)
        translation = np.array([[one, none, -x], [none, one, -y]]).transpose(2, 0, 1)
        return np.concatenate([rotation, translation * self.inverse_depth[:, None, None]], axis=2)

    @property
    def fraction(self) -> float:
        """Return smears over the motion per frame, a median; negative if time is reversed; NaN if unknown."""
        if self.velocity is None or len(self.rays) < MIN_SMEARS:
            return float("nan")
        flow = self.rows @ self.velocity
        return float(np.median((flow * self.displacement).sum(axis=1) / ((flow**2).sum(axis=1) + TINY)))


def common_fraction(frames: Sequence[ExposedFrame]) -> float:
    """Return exposure over frame interval, the median over all frames; NaN if no frame has it."""
    known = [abs(frame.fraction) for frame in frames if np.isfinite(frame.fraction)]
    return float(np.median(known)) if known else float("nan")


def roughness(velocities: Array) -> Array:
    """Return standard deviations (6,) of consecutive velocities (N, 6): one of rotation, one of translation.

    From how far each is from the mean of its neighbours; for fewer than three frames, the size of the
    velocities.
    """
    if len(velocities) < 3:
        return np.repeat(_size(velocities), 3)
    bend = velocities[1:-1] - 0.5 * (velocities[:-2] + velocities[2:])
    return np.repeat(_size(bend) * ROUGHNESS**0.5, 3)


def _size(vectors: Array) -> Array:
    """Return the robust root mean square (2,) of a coordinate of rotations and of translations (N, 6)."""
    squared = (vectors.reshape(-1, 2, 3) ** 2).mean(axis=2)
    return np.asarray(np.sqrt(np.median(squared, axis=0)), float)


def exposure_motion(frame: ExposedFrame, fraction: float, spread: Array) -> Array | None:
    """Return the motion (6,) during the exposure by smears and trajectory, rotation vector and translation.

    ``fraction`` is that of `common_fraction`, ``spread`` (6,) the standard deviations of the velocity that
    `roughness` measures. None if there are neither enough smears nor a velocity.
    """
    expected, precision = np.zeros(6), np.full(6, TINY)
    if frame.velocity is not None and np.isfinite(fraction):
        backwards = frame.fraction < 0  # open and close are exchanged; False for NaN
        expected = (-fraction if backwards else fraction) * frame.velocity
        precision = 1 / np.maximum(fraction * spread, 1e-3 * np.abs(expected).max() + TINY) ** 2
    if len(frame.rays) < MIN_SMEARS:
        return expected if frame.velocity is not None and np.isfinite(fraction) else None
    length = np.linalg.norm(frame.displacement, axis=1) + TINY
    share = min(1.0, INDEPENDENT_SMEARS / len(length))
    return reweighted_motion(
        frame.rows.transpose(2, 1, 0) / length,
        frame.displacement.T / length,
        steps=STEPS,
        scale=lambda missed: max(float(np.median(missed)), 1e-6),
        start=expected,
        prior=(expected, precision / share),
    )[0]


def smooth_velocities(poses: Array) -> Array:
    """Return the motion per frame (N, 6) about each of N consecutive poses, by splines through `velocities`.

    Generalised cross-validation decides how smooth. On RedKitchen the error of the rotations fell from 25 to
    21 %; on a rendered video of fewer, surer frames it left them as they were (13 %).
    """
    smoothed = velocities(poses)
    known = np.isfinite(smoothed).all(axis=1)
    if known.sum() < MIN_SPLINE:
        return smoothed
    time = np.arange(len(smoothed), dtype=np.float64)
    for column in range(smoothed.shape[1]):
        spline = make_smoothing_spline(time[known], smoothed[known, column])
        smoothed[known, column] = spline(time[known])
    return smoothed


def velocities(poses: Array) -> Array:
    """Return the motion per frame (N, 6) about each of N poses cam_from_world (N, 3, 4); NaN stays NaN.

    Half of that from the frame before to the one after, as one screw motion; at both ends from one neighbour.
    """
    last = len(poses) - 1
    if last < 1 or poses.shape[1:] != (3, 4):
        raise ValueError(f"expected two or more poses (N, 3, 4), got {poses.shape}")
    motions: NDArray[np.float64] = np.full((len(poses), 6), np.nan)
    for k in range(len(poses)):
        before, after = poses[max(k - 1, 0)], poses[min(k + 1, last)]
        if not np.isfinite([before, after]).all():
            continue
        R = after[:, :3] @ before[:, :3].T
        steps = min(k + 1, last) - max(k - 1, 0)
        rotation = rotation_vector(R)
        translation = after[:, 3] - R @ before[:, 3]
        # in the frame half-way between, in which the smears are observed
        halfway = translation - 0.5 * np.cross(rotation, translation)
        motions[k] = np.concatenate([rotation, halfway]) / steps
    return motions
