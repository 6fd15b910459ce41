"""The camera's path of a rendered video."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from blur2view.arrays import AnyArray as Array
from tools.rendering.motion import Trajectory

PERIOD = 15.0
"""Frames in which the path comes round once."""
HARMONICS = 3


@dataclass(frozen=True, kw_only=True)
class WanderingPath(Trajectory):
    """A camera that sways about: sums of sinusoids, the identity at time 0; time counts frames.

    Parameters
    ----------
    rotations, translations : ndarray of shape (HARMONICS, 3)
        Complex amplitudes of the rotation vector (radians) and of the position (scene units).
    """

    rotations: Array = field(default_factory=lambda: np.zeros((HARMONICS, 3), complex))
    translations: Array = field(default_factory=lambda: np.zeros((HARMONICS, 3), complex))

    def at(self, tau: float) -> tuple[Array, Array]:
        """Return rotation matrix (3, 3) and position (3,) at a time in frames: X_cam = R (X - position)."""
        angle = 2j * np.pi * np.arange(1, HARMONICS + 1) / PERIOD
        phase = np.exp(angle * tau) - 1
        R = np.asarray(cv2.Rodrigues((phase @ self.rotations).real)[0], np.float64)
        return R, np.asarray((phase @ self.translations).real)

    def scaled(self, factor: float) -> WanderingPath:
        """Return the same path, `factor` times as far."""
        return replace(self, rotations=self.rotations * factor, translations=self.translations * factor)


def sample_path(rng: np.random.Generator, rotation_share: float) -> WanderingPath:
    """Return a random path of unit speed that never stops: its first harmonic circles, the others shake."""
    falling = (0.16 ** np.arange(HARMONICS))[:, None]
    translations = (
        falling * (rng.normal(size=(HARMONICS, 3)) + 1j * rng.normal(size=(HARMONICS, 3))) * [0.7, 0.4, 0.7]
    )
    translations[0] = np.array([1.0, 0.8j * rng.choice([-1, 1]), 0.4]) * np.exp(2j * np.pi * rng.random())
    # a hand points to where it goes (RedKitchen's: cosine 0.86), unlike a camera that follows something
    sweep = np.cross(translations, [0, 0, 1.0])
    shake = falling * (rng.normal(size=(HARMONICS, 3)) + 1j * rng.normal(size=(HARMONICS, 3)))
    return WanderingPath(translations=translations, rotations=rotation_share * (0.7 * sweep + 0.7 * shake))
