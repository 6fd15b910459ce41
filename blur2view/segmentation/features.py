"""What the motion segmentation network is given of every smear, on the smear network's grid.

Beside the photograph it gets the direction which the camera's motion gives a smear of this length, and how
smear, uncertainty and residual lie to it. So what it learns does not depend on which way the camera went.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.geometry.sampson import serrmin
from blur2view.pipeline import Estimate
from blur2view.segmentation.score import MotionScore, displacement_of, measured_ends
from blur2view.smears.matches import STRIDE
from blur2view.smears.sampling import GridSmears

CHANNELS = 13
TURNS = 24  # directions that are tried for a smear of given length and place
MEET_PX = 1.0  # Sampson distance up to which a direction agrees with F
LONGEST_SCORE = 6.0  # standard deviations
LENGTH_UNIT = 3.0  # of log(1 + length)


def motion_features(found: Estimate, scored: MotionScore) -> NDArray[np.float32]:
    """Describe the smears of an estimate against the camera's motion.

    Parameters
    ----------
    found : Estimate
    scored : MotionScore
        Of the same estimate.

    Returns
    -------
    ndarray of shape (CHANNELS, h, w), float32
        Per cell of STRIDE x STRIDE pixels: (0, 1) unit double angle of the direction that the camera's
        motion predicts, times how sharply it does; (2, 3) double angle of the smear against it; (4)
        log(1 + length); (5, 6) log of the sigmas, px and rad; (7, 8) square roots of score and reach;
        (9, 10, 11) whether the camera's motion is an F, a homography, or none; (12) log(1 + length) that a
        homography predicts.
    """
    rows, columns = (cell_pixels(side) for side in found.field.shape)
    smears = GridSmears.at(
        found.field, *(index.ravel() for index in np.meshgrid(rows, columns, indexing="ij"))
    )
    near = np.ix_(
        *(
            np.minimum(pixels // STRIDE, cells - 1)  # the last cell may have no centre inside the photograph
            for pixels, cells in zip((rows, columns), scored.score.shape, strict=True)
        )
    )
    score, reach = scored.score[near], scored.reach[near]
    ends, geometry = measured_ends(smears, found.camera), found.geometry
    length, nothing = smears.length_px, np.zeros(len(smears.points))
    predicted_length = nothing
    if geometry.F is not None:
        predicted = directions_of_F(geometry.F, ends)
    elif geometry.H is not None:
        displacement = zero_where_unknown(displacement_of(geometry.H, ends.mean(axis=1)))
        predicted_length = np.hypot(*displacement.T)
        predicted = doubled(displacement) * (predicted_length / (1 + predicted_length))
    else:
        predicted = nothing.astype(complex)
    own = doubled(smears.displacement)
    across = nothing + np.pi / 2 if smears.sigma_rad is None else np.maximum(smears.sigma_rad, 1e-3)
    against = own * np.conj(unit(predicted))
    moves = geometry.F is not None, geometry.F is None and geometry.H is not None
    features = [
        predicted.real, predicted.imag, against.real, against.imag, np.log1p(length) / LENGTH_UNIT,
        np.log(smears.sigma_px) / LENGTH_UNIT, np.log(across) / LENGTH_UNIT,
        *(np.minimum(np.sqrt(v.ravel()), LONGEST_SCORE) / LENGTH_UNIT for v in (score, reach)),
        *(nothing + float(is_so) for is_so in (*moves, not any(moves))),
        np.log1p(predicted_length) / LENGTH_UNIT,
    ]  # fmt: skip
    return np.asarray(
        zero_where_unknown(np.stack(features)).astype(np.float32).reshape(CHANNELS, *score.shape)
    )


def cell_pixels(side: int) -> NDArray[np.int_]:
    """Return the pixels of one side nearest the centres of its cells, the upper or left ones of two."""
    return np.minimum(np.arange(0, side, STRIDE) + (STRIDE - 1) // 2, side - 1)


def directions_of_F(F: Array, ends: Array) -> Array:
    """Average, in double angle, the directions in which smears (N, 2, 2) of these places and lengths meet F.

    Returns
    -------
    ndarray of complex, shape (N,)
        Length 1 where only one direction does, 0 where all do, and where ends are NaN.
    """
    middle, half = ends.mean(axis=1), 0.5 * np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    half = np.maximum(half, MEET_PX)
    angles = np.arange(TURNS) * np.pi / TURNS
    steps = half[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None]  # (TURNS, N, 2)
    squared_px = np.stack([serrmin(F, np.stack([middle - s, middle + s], axis=1)) for s in steps])
    # against the nearest, which for a long smear between two tried directions is far from meeting F
    met = zero_where_unknown(np.exp(-0.5 * (squared_px - squared_px.min(axis=0)) / MEET_PX**2))
    return np.asarray(np.exp(2j * angles) @ met / np.maximum(met.sum(axis=0), 1))


def zero_where_unknown(values: Array) -> Array:
    """Put zeros where values are not finite: a distorted camera has no rays there."""
    return np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)


def doubled(displacement: Array) -> Array:
    """Return the unit double angle of displacements (N, 2), complex; 0 of none."""
    value = (displacement[:, 0] + 1j * displacement[:, 1]) ** 2
    return unit(value)


def unit(value: Array) -> Array:
    """Bring complex numbers to length 1; 0 stays."""
    size = np.abs(value)
    return np.asarray(np.where(size > 0, value / np.maximum(size, 1e-12), 0))
