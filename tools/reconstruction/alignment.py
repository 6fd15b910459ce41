"""Models against truth: similarity alignment, errors of poses, motion during exposures.

Poses are cam_from_world, [R | t] (N, 3, 4). A model's frame and scale are free, so that it is brought to the
truth by one similarity; motion within an exposure needs its scale alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blur2view.arrays import AnyArray as Array
from blur2view.geometry.rotation import rotation_vector


def centres(poses: Array) -> Array:
    """Return camera centres (..., 3) of poses (..., 3, 4)."""
    return np.asarray(-np.einsum("...ji,...j->...i", poses[..., :3], poses[..., 3]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Similarity:
    """X_true = scale * rotation X_model + shift."""

    scale: float
    rotation: Array
    shift: Array

    def poses(self, model: Array) -> Array:
        """Return a model's poses (N, 3, 4) in the truth's frame and scale."""
        R = model[..., :3] @ self.rotation.T
        t = self.scale * model[..., 3] - R @ self.shift
        return np.concatenate([R, t[..., None]], axis=-1)


def nearest_rotation(M: Array) -> Array:
    """Return the rotation (3, 3) nearest to a matrix."""
    U, _, Vt = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt)


def align(model: Array, true: Array) -> Similarity:
    """Return the similarity that aligns a model's poses (N, 3, 4) to the true ones.

    The rotation is the mean of those that bring each camera's orientation to its own (centres on a line, as
    those of a short walk are, would leave it open); scale and shift are then least squares of the centres.
    ValueError if there are fewer than two poses.
    """
    if len(model) < 2 or model.shape != true.shape:
        raise ValueError(f"expected two arrays (N, 3, 4), N >= 2, got {model.shape} and {true.shape}")
    R = nearest_rotation(np.einsum("nji,njk->ik", true[..., :3], model[..., :3]))
    there, here = centres(true), centres(model) @ R.T
    about, from_ = there - there.mean(axis=0), here - here.mean(axis=0)
    scale = float((about * from_).sum() / max((from_**2).sum(), 1e-30))
    return Similarity(scale=scale, rotation=R, shift=there.mean(axis=0) - scale * here.mean(axis=0))


def rotation_errors_deg(poses: Array, true: Array) -> Array:
    """Return angles (N,) between orientations, degrees."""
    rotations = np.einsum("nij,nkj->nik", poses[..., :3], true[..., :3])
    return np.degrees([np.linalg.norm(rotation_vector(R)) for R in rotations])


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What cameras did during N exposures: rotation vectors (N, 3), radians, and translations (N, 3).

    Of cam_close_from_cam_open; NaN where it is not known.
    """

    rotations: Array
    translations: Array

    @classmethod
    def between(cls, first: Array, last: Array) -> Motion:
        """Return the motions from cam_from_world (N, 3, 4) at open to that at close; NaN stays NaN."""
        R = np.einsum("nij,nkj->nik", last[..., :3], first[..., :3])
        translations = last[..., 3] - np.einsum("nij,nj->ni", R, first[..., 3])
        rotations = [rotation_vector(one) if np.isfinite(one).all() else np.full(3, np.nan) for one in R]
        return cls(rotations=np.array(rotations).reshape(-1, 3), translations=translations)

    def scaled(self, rotations: float, translations: float) -> Motion:
        """Return both scaled, the rotation as a vector."""
        return Motion(rotations=self.rotations * rotations, translations=self.translations * translations)


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionErrors:
    """A motion against the true one, frame by frame (N,); NaN where there is none.

    ``rotation`` and ``translation`` are lengths of differences over the true ones, ``heading_deg`` the angle
    between translations, ``forward`` whether time runs the right way.
    """

    rotation: Array
    translation: Array
    heading_deg: Array
    forward: Array

    @classmethod
    def of(cls, estimated: Motion, true: Motion) -> MotionErrors:
        """Return the errors frame by frame."""
        dot = (estimated.translations * true.translations).sum(axis=1)
        lengths = np.linalg.norm(estimated.translations, axis=1) * np.linalg.norm(true.translations, axis=1)
        return cls(
            rotation=relative_error(estimated.rotations, true.rotations),
            translation=relative_error(estimated.translations, true.translations),
            heading_deg=np.degrees(np.arccos(np.clip(dot / np.maximum(lengths, 1e-30), -1, 1))),
            forward=forwards(estimated, true),
        )


def relative_error(estimated: Array, true: Array) -> Array:
    """Return the length of the difference of vectors (N, 3) over the true length, (N,)."""
    return np.asarray(
        np.linalg.norm(estimated - true, axis=1) / np.maximum(np.linalg.norm(true, axis=1), 1e-30)
    )


def forwards(estimated: Motion, true: Motion) -> Array:
    """Return whether motions have the time direction of the true ones, (N,) float, NaN where unknown.

    Rotation and translation vote by their cosines: reversing time negates both, nearly.
    """

    def cosine(a: Array, b: Array) -> Array:
        lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
        return np.asarray((a * b).sum(axis=1) / np.maximum(lengths, 1e-30))

    vote = cosine(estimated.rotations, true.rotations) + cosine(estimated.translations, true.translations)
    return np.where(np.isfinite(vote), (vote > 0).astype(float), np.nan)


def common_scale(estimated: Array, true: Array) -> float:
    """Return the factor that scales true vectors (N, 3) to estimated ones: a median over frames, NaN ignored.

    NaN if none is estimated.
    """
    factors = (estimated * true).sum(axis=1) / np.maximum((true**2).sum(axis=1), 1e-30)
    known = factors[np.isfinite(factors)]
    return float(np.median(known)) if len(known) else float("nan")
