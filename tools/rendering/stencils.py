"""Outlines of the cards in a scene: alpha masks of polygons, ellipses, bars, foliage, letters and boxes."""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from tools.rendering.textures import spectral_noise

Alpha = NDArray[np.float32]

SIZE = 160  # side of a stencil in its own cells; a card stretches it over its box
FRACTION_BITS = 3  # OpenCV draws with coordinates in eighths of a cell


def blank() -> Alpha:
    """Return a stencil that covers nothing."""
    return np.zeros((SIZE, SIZE), np.float32)


def polygon(rng: np.random.Generator) -> Alpha:
    """Return a random star-shaped polygon of three to eight corners."""
    alpha = blank()
    angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 9))))
    radius = SIZE * rng.uniform(0.25, 0.5, len(angles))
    corners = SIZE / 2 + radius[:, None] * np.stack([np.cos(angles), np.sin(angles)], 1)
    cv2.fillPoly(alpha, [(corners * 8).astype(np.int32)], 1.0, cv2.LINE_AA, FRACTION_BITS)
    return alpha


def ellipse(rng: np.random.Generator) -> Alpha:
    """Return a random turned ellipse about the centre."""
    alpha, scale = blank(), SIZE * 8
    centre, axes = (
        (scale // 2, scale // 2),
        (int(scale * rng.uniform(0.15, 0.48)), int(scale * rng.uniform(0.15, 0.48))),
    )
    cv2.ellipse(alpha, centre, axes, rng.uniform(0, 180), 0, 360, 1.0, -1, cv2.LINE_AA, FRACTION_BITS)
    return alpha


def bars(rng: np.random.Generator) -> Alpha:
    """Return one to eight straight bars, thin or thick."""
    alpha = blank()
    for _ in range(int(rng.integers(1, 9))):
        first, last = (rng.uniform(-0.2, 1.2, (2, 2)) * SIZE * 8).astype(int).tolist()
        cv2.line(alpha, first, last, 1.0, int(rng.integers(1, 12)), cv2.LINE_AA, FRACTION_BITS)
    return alpha


def foliage(rng: np.random.Generator) -> Alpha:
    """Return thresholded 1/f noise: blots and holes of all sizes."""
    alpha = spectral_noise(rng, SIZE, rng.uniform(0.8, 1.8)) > rng.uniform(0, 1.0)
    return np.asarray(cv2.GaussianBlur(alpha.astype(np.float32), (0, 0), 0.7), np.float32)


def letters(rng: np.random.Generator) -> Alpha:
    """Return three capital letters or digits."""
    text = "".join(rng.choice(list("ABCDEFGHKMNRSTWXYZ2345789"), 3))
    ink = np.zeros((SIZE, SIZE), np.uint8)
    cv2.putText(ink, text, (8, SIZE // 2 + 20), cv2.FONT_HERSHEY_SIMPLEX, 2.3, 255, 9, cv2.LINE_AA)
    return np.asarray(ink / np.float32(255), np.float32)


def box(rng: np.random.Generator) -> Alpha:
    """Return a stencil filled up to a thin margin; `rng` is not used."""
    alpha = blank()
    alpha[2:-2, 2:-2] = 1.0
    return alpha


OUTLINES: dict[str, tuple[Callable[[np.random.Generator], Alpha], float]] = {
    "polygon": (polygon, 0.22),
    "ellipse": (ellipse, 0.2),
    "bars": (bars, 0.2),
    "foliage": (foliage, 0.15),
    "letters": (letters, 0.05),
    "box": (box, 0.18),
}
"""Outlines and their shares."""


def sample_stencil(rng: np.random.Generator) -> Alpha:
    """Return a random alpha mask (SIZE, SIZE) in [0, 1] of one card; its border is empty."""
    shares = [share for _, share in OUTLINES.values()]
    outline, _ = OUTLINES[str(rng.choice(list(OUTLINES), p=shares))]
    alpha = outline(rng)
    alpha[[0, -1]] = 0
    alpha[:, [0, -1]] = 0
    return alpha
