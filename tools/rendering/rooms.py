"""Pictures of rooms: straight, mostly parallel edges with little texture, which photographs of nature lack.

A room is boxes, frames, stripes, thin lines, cables and knobs of a few colours in one tilted frame of
reference, large ones below small ones, under soft shadows and light that changes slowly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tools.rendering import textures

Array = NDArray[Any]

WIDTH, HEIGHT = 740, 600
SIXTEENTHS = 4
"""Bits of a pixel's fraction that OpenCV draws with."""
BOXES = ((320, 3, 9), (130, 5, 25), (45, 4, 35), (14, 0, 40))
"""Sizes in pixels of boxes, and how many of them there are, from and below."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """The directions of a room's edges in the picture: turned by an angle, and in weak perspective."""

    angle: float
    tilt: Array

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Frame:
        """Draw one; half are upright to a degree or two."""
        angle = np.radians(rng.normal(0, 1.5)) if rng.random() < 0.5 else rng.uniform(0, np.pi)
        return cls(angle=float(angle), tilt=rng.normal(0, 0.0004, 2) * (rng.random() < 0.5))

    def place(self, points: Array) -> NDArray[np.int32]:
        """Return points (N, 2) of the room in sixteenths of a pixel."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        turned = np.asarray(points, float) @ np.array([[c, s], [-s, c]])
        seen = turned / (1 + turned @ self.tilt)[:, None]
        return np.asarray(np.round((seen + (WIDTH / 2, HEIGHT / 2)) * 2**SIXTEENTHS), np.int32)


def room(rng: np.random.Generator) -> Array:
    """Return a picture (H, W, 3), uint8."""
    frame = Frame.drawn(rng)
    palette = [colour(rng) for _ in range(int(rng.integers(3, 8)))]
    image = np.empty((HEIGHT, WIDTH, 3), np.float32)
    image[:] = shade_of(rng, palette)
    lean = rng.choice([0.3, 1.5, 2.5])
    for size, least, most in BOXES:
        for _ in range(int(rng.integers(least, most))):
            add_box(rng, image, frame, palette, size, lean if rng.random() < 0.85 else 30)
    for _ in range(int(rng.integers(0, 4))):
        add_stripes(rng, image, frame, palette)
    for _ in range(int(rng.integers(0, 8))):
        along = np.array([1, 0] if rng.random() < 0.5 else [0, 1]) * rng.uniform(30, 500)
        centre = rng.uniform((-400, -300), (400, 300))
        add_line(rng, image, frame.place(np.array([centre - along, centre + along])), palette)
    for _ in range(int(rng.choice([0, 1, 3]))):  # cables: parabolas
        s = np.linspace(0, 1, 24)[:, None]
        a, b, c = rng.uniform(-400, 400, (3, 2))
        add_line(rng, image, frame.place((1 - s) ** 2 * a + 2 * s * (1 - s) * b + s * s * c), palette)
    for _ in range(int(rng.choice([0, 3, 15]))):  # cups, knobs, marks
        mask = np.zeros((HEIGHT, WIDTH), np.uint8)
        radius, x, y = 16 * rng.uniform((2, 0, 0), (30, WIDTH, HEIGHT))
        axes = int(radius), int(radius * rng.uniform(0.4, 1))
        angle = np.degrees(frame.angle)
        cv2.ellipse(mask, (int(x), int(y)), axes, angle, 0, 360, 255, -1, cv2.LINE_AA, SIXTEENTHS)
        paint(rng, image, mask, shade_of(rng, palette))
    slow = textures.spectral_noise(rng, 768, rng.uniform(1.8, 2.4))[:HEIGHT, :WIDTH, None]
    image *= np.exp(slow * np.float32(rng.uniform(0, 0.2)))
    return (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)


def colour(rng: np.random.Generator) -> Array:
    """Return a colour (3,), linear; most are nearly grey."""
    value = np.exp(rng.uniform(np.log(0.08), np.log(0.95)))
    tint = rng.normal(0, rng.choice([0.03, 0.08, 0.2], p=[0.5, 0.38, 0.12]), 3)
    return np.asarray(np.clip(value * (1 + tint), 0.01, 1), np.float32)


def shade_of(rng: np.random.Generator, palette: list[Array]) -> Array:
    """Return one of the colours, brighter or darker."""
    return np.asarray(palette[rng.integers(len(palette))] * np.float32(np.exp(rng.normal(0, 0.15))))


def paint(rng: np.random.Generator, image: Array, mask: Array, fill: Array) -> None:
    """Blend a colour, often under a gradient of light, into the picture where the mask (8 bits) is."""
    x, y, w, h = cv2.boundingRect(mask)
    if w < 1 or h < 1:
        return
    alpha = mask[y : y + h, x : x + w, None].astype(np.float32) / 255
    gx, gy = rng.normal(0, 0.25, 2) * (rng.random() < 0.6)
    light = np.add.outer(gy * (np.arange(h) / HEIGHT - 0.5), gx * (np.arange(w) / WIDTH - 0.5))[..., None]
    part = image[y : y + h, x : x + w]
    part += alpha * (fill * np.exp(light).astype(np.float32) - part)


def add_box(
    rng: np.random.Generator, image: Array, frame: Frame, palette: list[Array], size: float, lean: float
) -> None:
    """Add a box of about this size, some with a shadow, a frame or a seam; it leans by some degrees."""
    width, height = size * np.exp(rng.normal(0, 0.6, 2))
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (width / 2, height / 2)
    turn, shear = np.radians(rng.normal(0, lean, 2))
    matrix = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn + shear), np.cos(turn + shear)]])
    outline = frame.place(corners @ matrix + rng.uniform((-450, -400), (450, 400)))
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.fillPoly(mask, [outline], 255, cv2.LINE_AA, SIXTEENTHS)
    if rng.random() < 0.25:
        shifted = np.roll(mask, rng.integers(-10, 11, 2), (0, 1))
        shadow = cv2.GaussianBlur(shifted, (0, 0), rng.uniform(2, 14))[..., None].astype(np.float32) / 255
        image *= 1 - shadow * np.float32(rng.uniform(0.1, 0.5))
    paint(rng, image, mask, shade_of(rng, palette))
    if rng.random() < 0.3:
        add_line(rng, image, np.r_[outline, outline[:1]], palette)


def add_line(rng: np.random.Generator, image: Array, points: NDArray[np.int32], palette: list[Array]) -> None:
    """Add a line of one to three pixels through points of `Frame.place`."""
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.polylines(mask, [points], False, 255, int(rng.integers(1, 4)), cv2.LINE_AA, SIXTEENTHS)
    paint(rng, image, mask, shade_of(rng, palette))


def add_stripes(rng: np.random.Generator, image: Array, frame: Frame, palette: list[Array]) -> None:
    """Add shelves, slats or tiles: repeated bars in a box, in one direction or both."""
    centre = rng.uniform((-380, -300), (380, 300))
    size = np.exp(rng.uniform(np.log(60), np.log(500), 2))
    period = np.exp(rng.uniform(np.log(6), np.log(70)))
    thick = max(1.0, period * rng.uniform(0.05, 0.5))
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    for axis in ([0], [1], [0, 1])[rng.choice(3, p=[0.35, 0.35, 0.3])]:
        bar = size.copy()
        bar[axis] = thick
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * bar - size / 2 + centre
        for start in np.arange(0, size[axis], period):
            moved = corners + start * np.eye(2)[axis]
            cv2.fillPoly(mask, [frame.place(moved)], 255, cv2.LINE_AA, SIXTEENTHS)
    paint(rng, image, mask, shade_of(rng, palette))
