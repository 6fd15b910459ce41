"""The motion of a camera during exposures whose place in a trajectory is known.

Where a reconstruction holds the photographs of a video, two things are known beside the smears: how far away
every feature is, which makes its smear linear in the camera's rotation and translation; and how the camera
moves from frame to frame, of which the exposure is a fraction, the same in every frame. So the smears measure
that fraction, and where this frame's rotation departs from it. Both are weighed. A cubic spline through the
poses says what the camera did between them, as surely as it predicts a pose from the others; smears say by
how much that is too sure, as of a shake that is faster than the frames. Of positions the spline alone says
more: smears err by more than a short exposure's parallax. ``python -m tools.evaluation.placed`` measures what
comes of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from blur2view.arrays import TINY, Array
from blur2view.geometry.rotation import rotation_flow, rotation_matrix, rotation_vector
from blur2view.robust.reweighted import reweighted_motion

INDEPENDENT_SMEARS = 4  # at most: with more, smears are called surer than tools.evaluation.placed shows them
MIN_SMEARS = 8  # smears; with fewer a frame's motion is not estimated
STEPS = 15  # of reweighting: from a trajectory that is far off it takes ten
REACH = 3  # frames before and after through which the spline about a frame goes
LEAST_SHARE = 1e-3  # of the largest part of a motion, the standard deviation of a part that is known
SUREST = 0.01  # of the size of velocities, their least standard deviation
BEYOND = 3.0  # times less sure where one side has no frame
FACTORS: Array = np.geomspace(0.25, 1024, 13)  # by which a trajectory may be less sure than it seems
FREEDOM = 4  # degrees, of Student's t: some frames are outliers


@dataclass(frozen=True, kw_only=True, eq=False)
class ExposedFrame:
    """A frame's smears at features of known depth, and the trajectory's velocity there."""

    rays: Array  # (N, 2): x/z, y/z of the features at mid exposure
    displacement: Array  # (N, 2): their smears, open to close, in the same coordinates
    inverse_depth: Array  # (N,): one over the features' z
    # (6,): rotation vector and translation per frame, of cam_later_from_cam_earlier; None without neighbours
    velocity: Array | None

    @property
    def rows(self) -> Array:
        """Return the Jacobian (N, 2, 6) of the features by rotation vector and translation."""
        rotation = rotation_flow(self.rays).transpose(2, 0, 1)
        x, y = self.rays.T
        one, none = np.ones_like(x), np.zeros_like(x)
        translation = np.array([[one, none, -x], [none, one, -y]]).transpose(2, 0, 1)
        return np.concatenate([rotation, translation * self.inverse_depth[:, None, None]], axis=2)

    @property
    def sense(self) -> int:
        """Return -1 if open and close are exchanged, as the trajectory shows."""
        return -1 if self.fraction < 0 else 1

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


def exposure_motion(frame: ExposedFrame, fraction: float, spread: Array) -> Array | None:
    """Return the motion (6,) during the exposure by smears and trajectory, rotation vector and translation.

    ``fraction`` is that of `common_fraction`, ``spread`` (6,) the standard deviations of the velocity. None
    if there are neither enough smears nor a velocity.
    """
    expected, precision = np.zeros(6), np.full(6, TINY)
    if frame.velocity is not None and np.isfinite(fraction):
        expected = fraction * frame.sense * frame.velocity
        precision = 1 / np.maximum(fraction * spread, LEAST_SHARE * np.abs(expected).max() + TINY) ** 2
    if len(frame.rays) < MIN_SMEARS:
        return expected if frame.velocity is not None and np.isfinite(fraction) else None
    return _weighed(frame, expected, precision)[0]


def _weighed(frame: ExposedFrame, expected: Array, precision: Array) -> tuple[Array, Array]:
    """Return the motion (6,) by smears and an expectation, and the information (6, 6) of the smears."""
    length = np.linalg.norm(frame.displacement, axis=1) + TINY
    share = min(1.0, INDEPENDENT_SMEARS / len(length))
    rows, flow = frame.rows.transpose(2, 1, 0) / length, frame.displacement.T / length
    motion, missed = reweighted_motion(
        rows,
        flow,
        steps=STEPS,
        scale=lambda missed: max(float(np.median(missed)), 1e-6),
        start=expected,
        prior=(expected, precision / share),
    )
    weight = share / (max(float(np.median(missed)), 1e-6) ** 2 + missed**2)
    return motion, np.einsum("idn,jdn,n->ij", rows, rows, weight)


def widened(frames: Sequence[ExposedFrame], fraction: float, spreads: Array) -> Array:
    """Return standard deviations (N, 6) of velocities: of rotations as large as smears show that they are.

    A shake faster than the frames looks like a slow one in their poses: only smears show that it is not. One
    factor, of largest likelihood (Student's t with `FREEDOM`, for what smears alone say of each frame's
    rotation less that of the trajectory). Of translations zero: smears of known rotation make them worse.
    """
    apart, own, path = [], [], []
    for frame, spread in zip(frames, spreads, strict=True):
        if frame.velocity is not None and len(frame.rays) >= MIN_SMEARS and np.isfinite(spread).all():
            expected = fraction * frame.sense * frame.velocity
            known = 1 / (LEAST_SHARE * np.abs(expected).max() + TINY) ** 2
            motion, information = _weighed(frame, expected, np.repeat([TINY, known], 3))
            apart.append((motion - expected)[:3])
            own.append(np.linalg.pinv(information[:3, :3], hermitian=True))
            path.append((fraction * spread[:3]) ** 2)
    if not apart:
        return np.asarray(spreads * np.repeat([1.0, 0.0], 3))
    d, C, variance = np.array(apart), np.array(own), np.array(path)
    likely = []
    for factor in FACTORS:
        covariance = C + np.eye(3) * (variance * factor**2)[:, None, :]
        far = (d * np.linalg.solve(covariance, d[..., None])[..., 0]).sum(axis=1)
        spread_log = np.linalg.slogdet(covariance)[1]
        likely.append(-0.5 * (spread_log + (FREEDOM + 3) * np.log1p(far / FREEDOM)).sum())
    return np.asarray(spreads * np.repeat([FACTORS[int(np.argmax(likely))], 0.0], 3))


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """Consecutive poses cam_from_world (N, 3, 4) of a video, NaN where there is none, as a local spline."""

    poses: Array

    def __post_init__(self) -> None:
        if len(self.poses) < 2 or self.poses.shape[1:] != (3, 4):
            raise ValueError(f"expected two or more poses (N, 3, 4), got {self.poses.shape}")

    def ends(self, fraction: float) -> Array:
        """Return where the camera is (N, 2, 6) as exposures of this fraction of an interval begin and end.

        On a cubic spline through the poses about each frame: a rotation vector and the centre, both in the
        camera of mid exposure. NaN of a frame without a pose or a neighbour.
        """
        found = np.full((len(self.poses), 2, 6), np.nan)
        for frame, (times, places) in enumerate(self._windows):
            if len(times) > 1:
                found[frame] = _through(times, places, [-fraction / 2, fraction / 2])
        return found

    def velocities(self, fraction: float) -> Array:
        """Return the motions (N, 6) during these exposures, over the fraction, NaN where unknown.

        A rotation vector and a translation in the camera half-way, in which smears are observed.
        """
        found = np.full((len(self.poses), 6), np.nan)
        for frame, ends in enumerate(self.ends(fraction)):
            if np.isfinite(ends).all():
                first, last = map(_pose, ends)
                R = last[:, :3] @ first[:, :3].T
                rotation, translation = rotation_vector(R), last[:, 3] - R @ first[:, 3]
                halfway = translation - 0.5 * np.cross(rotation, translation)
                found[frame] = np.concatenate([rotation, halfway]) / fraction
        return found

    def spreads(self, fraction: float) -> Array:
        """Return standard deviations (N, 6) of the velocities, one of rotations and one of translations.

        From how far each pose is from a spline through the others, of twice the step. Half the step lowers
        that as a cubic does, by the square of what it lowers a straight line's by: a sixteenth where the path
        is smooth, nothing where it changes faster than frames follow one another. Of fewer than five poses in
        a row, the size of the velocities.
        """
        missed: list[Array] = []
        bends: tuple[list[Array], list[Array]] = [], []
        for times, places in self._windows:
            by_time = dict(zip(times.tolist(), places, strict=True))
            for bend, step in zip(bends, (1, 2), strict=True):
                if {-step, step} <= by_time.keys():
                    bend.append(0.5 * (by_time[-step] + by_time[step]))
            if {-1, 1} <= by_time.keys() and len(times) > 3:
                missed.append(_through(times[times != 0], places[times != 0], [0.0])[0])
        if not missed or not bends[1]:
            return np.tile(np.repeat(_size(self.velocities(fraction)), 3), (len(self.poses), 1))
        decay = np.clip(_size(np.array(bends[0])) / (_size(np.array(bends[1])) + TINY), 0.25, 1.0) ** 2
        within = np.array([len(times) > 0 and times[0] < 0 < times[-1] for times, _ in self._windows])
        size = _size(np.array(missed)) * decay * 2**0.5 * (2 - fraction)
        size = np.maximum(size, SUREST * _size(self.velocities(fraction)))
        return np.where(within, 1.0, BEYOND)[:, None] * np.repeat(size, 3)

    def shares(self, fraction: float, spreads: Array) -> Array:
        """Return the shares (N, 6) of velocities, 0 to 1, to expect with these standard deviations."""
        noise = spreads / (np.repeat(_size(self.velocities(fraction)), 3) + TINY)
        return np.asarray(np.clip(1 - noise**2, 0, 1))

    @cached_property
    def _windows(self) -> list[tuple[Array, Array]]:
        """Return times in frames about each frame, and there the camera in its own as of `ends`: (M, 6)."""
        known: NDArray[np.bool_] = np.all(np.isfinite(self.poses), axis=(1, 2))
        windows: list[tuple[Array, Array]] = []
        for frame, own in enumerate(self.poses):
            about = np.arange(max(frame - REACH, 0), min(frame + REACH + 1, len(self.poses)))
            about = about[known[about] & known[frame]]
            R = self.poses[about, :, :3] @ own[:, :3].T
            centres = -np.einsum("kji,kj->ki", R, self.poses[about, :, 3] - R @ own[:, 3])
            turns = np.array([rotation_vector(one) for one in R]).reshape(-1, 3)
            windows.append(((about - frame).astype(np.float64), np.hstack([turns, centres])))
        return windows


def _through(times: Array, places: Array, wanted: Sequence[float]) -> Array:
    """Return values (len(wanted), 6) of a spline through places (N, 6), cubic where there are four."""
    return np.asarray(make_interp_spline(times, places, k=min(3, len(times) - 1))(wanted))


def _pose(place: Array) -> Array:
    """Return cam_from_own (3, 4) of a rotation vector and a centre (6,)."""
    R = rotation_matrix(place[:3])
    return np.column_stack([R, -R @ place[3:]])


def _size(vectors: Array) -> Array:
    """Return the robust root mean square (2,) of a coordinate of rotations and of translations (N, 6)."""
    squared = (vectors[np.isfinite(vectors).all(axis=1)].reshape(-1, 2, 3) ** 2).mean(axis=2)
    return np.asarray(np.sqrt(np.median(squared, axis=0)), float)
