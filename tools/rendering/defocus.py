"""Blur without a direction: point spreads of lenses out of focus, discs, apertures with blades, rings."""

import cv2
import numpy as np

from blur2view.arrays import AnyArray as Array

KINDS = ("disc", "blades", "gaussian", "ring")
SHARES = (0.45, 0.25, 0.18, 0.12)
"""How often each kind is drawn."""
ELLIPTIC_SHARE, LEAST_AXIS = 0.3, 0.75
"""Share of point spreads that are squeezed, as off a lens's axis, and by how much at most."""


def point_spread(rng: np.random.Generator, radius_px: float, kind: str | None = None) -> Array:
    """Return a point spread of this radius, (n, n) float32 of sum one, of a kind that is drawn.

    Of a disc the radius is its own; of others it is that of the disc with as wide a spread: twice the
    standard deviation along an axis.
    """
    kind = kind or str(rng.choice(KINDS, p=SHARES))
    squeeze = rng.uniform(LEAST_AXIS, 1) if rng.random() < ELLIPTIC_SHARE else 1.0
    angle, blades = rng.uniform(0, np.pi), int(rng.integers(5, 10))
    reach = int(np.ceil((2.5 if kind == "gaussian" else 1.5) * radius_px / squeeze**0.5)) + 1
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(np.float32)
    x, y = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    x, y = x * squeeze**0.5, y / squeeze**0.5
    distance = np.hypot(x, y)
    match kind:
        case "gaussian":
            kernel = np.exp(-2 * (distance / radius_px) ** 2)
        case "blades":
            sector = 2 * np.pi / blades
            along = np.remainder(np.arctan2(y, x), sector) - sector / 2
            # the apothem of the regular polygon with the disc's second moment
            apothem = radius_px * np.sqrt(6 / (2 + 1 / np.cos(np.pi / blades) ** 2) / 2)
            kernel = np.clip(apothem - distance * np.cos(along) + 0.5, 0, 1)
        case "ring":
            bright, hole = rng.uniform(0.3, 1), rng.uniform(0.4, 0.8)
            inside = np.clip(radius_px + 0.5 - distance, 0, 1)
            kernel = inside - bright * np.clip(hole * radius_px + 0.5 - distance, 0, 1)
        case _:
            kernel = np.clip(radius_px + 0.5 - distance, 0, 1)
    kernel = np.maximum(kernel, 0)
    return np.asarray(kernel / kernel.sum(), np.float32)


def defocused(rng: np.random.Generator, linear: Array, radius_px: float, kind: str | None = None) -> Array:
    """Return radiance (H, W, C), with its alpha if it has one, out of focus by this radius."""
    if radius_px < 0.3:
        return linear
    kernel, image = point_spread(rng, radius_px, kind), linear.astype(np.float32)
    border = cv2.BORDER_REFLECT if image.shape[2] == 3 else cv2.BORDER_CONSTANT
    return np.asarray(cv2.filter2D(image, -1, kernel, borderType=border))
