"""Planes that face the camera, and layers of one: what tests of the renderer show."""

from typing import Any

import numpy as np

from tools.rendering.motion import Trajectory
from tools.rendering.scene import Layer, Plane

SIZE = (160, 128)


def facing(depth: float = 1.0, texture: Any = 0.5, texels_per_unit: float = 100.0) -> Plane:
    """Return a plane across the optical axis, of a texture (h, w, 3) or one grey.

    Texel columns run down the image and rows to the right.
    """
    pixels = np.full((64, 64, 3), texture, np.float32) if np.isscalar(texture) else texture
    normal = np.array([0.0, 0, 1])
    return Plane(normal=normal, offset=depth, texture=pixels, texels_per_unit=texels_per_unit, turn=0.0)


def wall(plane: Plane, **more: Any) -> Layer:
    """Return a flat layer of one plane that is everywhere."""
    return Layer(planes=(plane,), relief=np.zeros((2, 2), np.float32), **more)


def card(plane: Plane, box: tuple[float, float, float, float], **more: Any) -> Layer:
    """Return a flat layer of one plane in a box (x, y, width, height) of the image, pixels."""
    return wall(plane, stencil=np.ones((160, 160), np.float32), box=box, **more)


def path(rotation: Any = (0.0, 0, 0), translation: Any = (0.0, 0, 0)) -> Trajectory:
    """Return a path of constant velocity."""
    return Trajectory(rotation=np.array(rotation), translation=np.array(translation))
