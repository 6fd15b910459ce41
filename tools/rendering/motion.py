"""Camera and object paths over one exposure, in SE(3)."""

from dataclasses import dataclass, field, replace
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

KINDS = {"rotation": 0.12, "translation": 0.18, "forward": 0.17, "orbit": 0.13, "mixed": 0.4}
"""Kinds of camera paths and their shares."""


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """A smooth rigid path over the exposure time tau in [-1/2, 1/2], the identity at tau = 0.

    With s = tau + acceleration * tau**2 the rotation vector is ``rotation * s + rotation_bend * tau**2``
    (radians) and the position ``translation * s + translation_bend * tau**2`` (scene units); what is not
    given is zero.
    """

    rotation: Vector = field(default_factory=lambda: np.zeros(3))
    translation: Vector = field(default_factory=lambda: np.zeros(3))
    rotation_bend: Vector = field(default_factory=lambda: np.zeros(3))
    translation_bend: Vector = field(default_factory=lambda: np.zeros(3))
    acceleration: float = 0.0

    def at(self, tau: float) -> tuple[Vector, Vector]:
        """Return the rotation matrix (3, 3) and position (3,) at exposure time tau."""
        s = tau + self.acceleration * tau**2
        vector = self.rotation * s + self.rotation_bend * tau**2
        R = np.asarray(cv2.Rodrigues(vector)[0], np.float64)
        return R, self.translation * s + self.translation_bend * tau**2

    def scaled(self, factor: float) -> Self:
        """Return the same path, `factor` times as far."""
        vectors = ("rotation", "translation", "rotation_bend", "translation_bend")
        return replace(self, **{name: getattr(self, name) * factor for name in vectors})


def unit(rng: np.random.Generator, weights: tuple[float, float, float] = (1, 1, 1)) -> Vector:
    """Return a random direction in 3D, stretched by `weights` before normalisation."""
    vector = rng.normal(size=3) * weights
    return vector / np.linalg.norm(vector)


def bend_of(rng: np.random.Generator, velocity: Vector, ratio: float) -> Vector:
    """Return a random bend of the given size relative to the velocity."""
    return ratio * np.linalg.norm(velocity) * unit(rng)


def sample_camera_path(rng: np.random.Generator, straight: bool = False) -> tuple[Trajectory, str]:
    """Return a random camera path of unit size, which the renderer scales, and the name of its kind.

    An ``orbit`` goes sideways, with a rotation that mostly holds the middle distance still, as one does who
    follows something, and in a quarter of the cases moves the image further.
    """
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    translation = unit(rng, (1, 0.8, 0.8))
    rotation = unit(rng, (1, 1, 0.7)) * rng.uniform(0.1, 1.0)
    if kind == "rotation":
        translation = np.zeros(3)
    elif kind == "translation":
        rotation = np.zeros(3)
    elif kind == "forward":
        translation = unit(rng, (0.25, 0.25, 1))
        rotation *= rng.choice([0.0, 0.15, 0.3])
    elif kind == "orbit":
        translation = unit(rng, (1, 0.8, 0.2))
        follow = rng.uniform(0.4, 1.2) * (1 if rng.random() < 0.75 else -1)
        rotation = np.cross([0, 0, 1], translation) * follow + 0.1 * rotation
    if straight:
        ratio = 0.0
    else:  # not at all, slightly (a pan) or as much as it moves (a hand)
        ratio = float(rng.choice([0.0, 0.15, 0.6, 1.2], p=[0.3, 0.35, 0.25, 0.1]) * rng.random())
    path = Trajectory(
        rotation=rotation,
        translation=translation,
        rotation_bend=bend_of(rng, rotation, ratio),
        translation_bend=bend_of(rng, translation, ratio),
        acceleration=0.0 if straight else float(rng.normal(0, 0.2)),
    )
    return path, kind


def sample_object_path(rng: np.random.Generator, camera: Trajectory) -> Trajectory:
    """Return a moving object's random path: another direction, comparable size, little rotation."""
    speed = np.linalg.norm(camera.translation) + 0.7 * np.linalg.norm(camera.rotation)
    return Trajectory(
        rotation=unit(rng) * speed * rng.uniform(0, 0.5),
        translation=unit(rng, (1, 0.6, 0.5)) * speed * rng.uniform(0.4, 1.5),
    )
