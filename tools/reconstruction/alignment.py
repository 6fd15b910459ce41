"""Models against truth: similarity alignment, errors of poses, motion during exposures.

Poses are cam_from_world, [R | t] (N, 3, 4). A model's frame and scale are free, so that it is brought to the
truth by one similarity; motion within an exposure needs its scale alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.geometry.rotation import rotation_vector

Array = NDArray[Any]


def centres(poses: Array) -> Array:
    """Camera centres (..., 3) of poses (..., 3, 4)."""
    return np.asarray(-np.einsum("...ji,...j->...i", poses[..., :3], poses[..., 3]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Similarity:
    """X_true = scale * rotation X_model + shift."""

    scale: float
    rotation: Array
    shift: Array

    def poses(self, model: Array) -> Array:
        """Give a model's poses (N, 3, 4) in the truth's frame and scale."""
        R = model[..., :3] @ self.rotation.T
        t = self.scale * model[..., 3] - R @ self.shift
        return np.concatenate([R, t[..., None]], axis=-1)


def nearest_rotation(M: Array) -> Array:
    """Rotation (3, 3) nearest to a matrix."""
    U, _, Vt = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt)


def align(model: Array, true: Array) -> Similarity:
    """Bring a model's poses (N, 3, 4) to the true ones.

    The rotation is the mean of those that bring each camera's orientation to its own (centres on a line, as
    those of a short walk are, would leave it open); scale and shift are then least squares of the centres.

    Raises
    ------
    ValueError
        If there are fewer than two poses.
    """
    if len(model) < 2 or model.shape != true.shape:
        raise ValueError(f"expected two arrays (N, 3, 4), N >= 2, got {model.shape} and {true.shape}")
    R = nearest_rotation(np.einsum("nji,njk->ik", true[..., :3], model[..., :3]))
    there, here = centres(true), centres(model) @ R.T
    about, from_ = there - there.mean(axis=0), here - here.mean(axis=0)
    scale = float((about * from_).sum() / max((from_**2).sum(), 1e-30))
    return Similarity(scale=scale, rotation=R, shift=there.mean(axis=0) - scale * here.mean(axis=0))


def rotation_errors_deg(poses: Array, true: Array) -> Array:
    """Angles (N,) between orientations, degrees."""
    turns = np.einsum("nij,nkj->nik", poses[..., :3], true[..., :3])
    return np.degrees([np.linalg.norm(rotation_vector(turn)) for turn in turns])


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What cameras did during N exposures: rotation vectors (N, 3), radians, and translations (N, 3).

    Of cam_close_from_cam_open; NaN where it is not known.
    """

    turns: Array
    moves: Array

    @classmethod
    def between(cls, first: Array, last: Array) -> Motion:
        """From cam_from_world (N, 3, 4) at shutter-open and at shutter-close; NaN stays NaN."""
        R = np.einsum("nij,nkj->nik", last[..., :3], first[..., :3])
        moves = last[..., 3] - np.einsum("nij,nj->ni", R, first[..., 3])
        turns = [rotation_vector(turn) if np.isfinite(turn).all() else np.full(3, np.nan) for turn in R]
        return cls(turns=np.array(turns).reshape(-1, 3), moves=moves)

    def scaled(self, turns: float, moves: float) -> Motion:
        """Scale both, the rotation as a vector."""
        return Motion(turns=self.turns * turns, moves=self.moves * moves)


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionErrors:
    """A motion against the true one, frame by frame (N,); NaN where there is none.

    ``turn`` and ``move`` are lengths of differences over the true lengths, ``heading_deg`` the angle
    between translations, ``forward`` whether time runs the right way.
    """

    turn: Array
    move: Array
    heading_deg: Array
    forward: Array

    @classmethod
    def of(cls, found: Motion, true: Motion) -> MotionErrors:
        """Compare frame by frame."""
        dot = (found.moves * true.moves).sum(axis=1)
        lengths = np.linalg.norm(found.moves, axis=1) * np.linalg.norm(true.moves, axis=1)
        return cls(
            turn=relative_error(found.turns, true.turns),
            move=relative_error(found.moves, true.moves),
            heading_deg=np.degrees(np.arccos(np.clip(dot / np.maximum(lengths, 1e-30), -1, 1))),
            forward=forwards(found, true),
        )


def relative_error(found: Array, true: Array) -> Array:
    """Length of the difference of vectors (N, 3) over the true length, (N,)."""
    return np.asarray(np.linalg.norm(found - true, axis=1) / np.maximum(np.linalg.norm(true, axis=1), 1e-30))


def forwards(found: Motion, true: Motion) -> Array:
    """Whether motions run the way of the true ones, (N,) float, NaN where unknown.

    Rotation and translation vote by their cosines: reversing time turns both about, nearly.
    """

    def cosine(a: Array, b: Array) -> Array:
        lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
        return np.asarray((a * b).sum(axis=1) / np.maximum(lengths, 1e-30))

    vote = cosine(found.turns, true.turns) + cosine(found.moves, true.moves)
    return np.where(np.isfinite(vote), (vote > 0).astype(float), np.nan)


def common_scale(found: Array, true: Array) -> float:
    """One factor that brings true vectors (N, 3) to found ones: the median over frames, NaN ignored.

    NaN if none is found.
    """
    factors = (found * true).sum(axis=1) / np.maximum((true**2).sum(axis=1), 1e-30)
    known = factors[np.isfinite(factors)]
    return float(np.median(known)) if len(known) else float("nan")
