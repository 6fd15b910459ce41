"""Drawing primitives on RGB pictures: the canvas, lines, text, colours."""

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from blur2view.arrays import AnyArray
from blur2view.networks.smear_network import floats_of
from blur2view.output_files import SIGNED_BY

Picture = NDArray[np.uint8]  # (H, W, 3), RGB
INK, PAPER, FAINT = (235, 235, 235), (26, 26, 30), (165, 165, 165)
TEXT_SIZE, LEADING_PX = 0.42, 17
HEAD_SIZE, HEAD_LEADING_PX = 0.55, 22  # of the verdict
# The longer side of the drawn photograph: small ones are enlarged until a smear can be seen, large ones
# reduced so that the file stays a picture to look at.
MIN_SIDE_PX, MAX_SIDE_PX = 640, 1280
_FONT = cv2.FONT_HERSHEY_SIMPLEX
# Pictures are for looking at: the fastest deflate takes two thirds of the time of 3 of 9, for 5 % more bytes.
_PNG_EFFORT = 1
_SHIFT = 4  # OpenCV draws with 1/16 px


@dataclass(frozen=True, kw_only=True)
class View:
    """The scale from the photograph to the canvas."""

    width: int  # of the canvas, pixels
    height: int
    scale: float  # canvas pixels per pixel of the photograph

    @classmethod
    def of(cls, shape: tuple[int, ...], longest: int | None = None) -> "View":
        """Return the canvas of a photograph of shape (H, W, ...), by default one to look at."""
        height, width = shape[:2]
        longer = max(height, width)
        scale = (longest or min(max(longer, MIN_SIDE_PX), MAX_SIDE_PX)) / longer
        return cls(width=max(round(width * scale), 1), height=max(round(height * scale), 1), scale=scale)

    def to_canvas(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (..., 2) of the photograph on the canvas; its corners are the canvas's corners."""
        return (points + 0.5) * self.scale - 0.5

    def resized(self, image: AnyArray) -> NDArray[np.float32]:
        """Return the photograph, as `rgb_of` takes it, at this scale: RGB in [0, 1]."""
        if self.scale >= 1:
            image = floats_of(image)  # else the smaller one takes less memory
        interpolation = cv2.INTER_AREA if self.scale < 1 else cv2.INTER_LINEAR
        small = cv2.resize(image, (self.width, self.height), interpolation=interpolation)
        return floats_of(small.reshape(self.height, self.width, *image.shape[2:]))

    def picture(self, image: AnyArray) -> Picture:
        """Return the photograph at this scale, of 8 bits."""
        return np.round(255 * np.clip(self.resized(image), 0, 1)).astype(np.uint8)

    def backdrop(self, image: AnyArray) -> Picture:
        """Return the photograph at this scale, paled and darkened so that colours on it stand out."""
        mixed = np.column_stack([0.4 / 3 + 0.25 * np.eye(3), np.full(3, 0.08)])  # grey, colour and a constant
        pale: Picture = np.clip(cv2.transform(self.resized(image), 255 * mixed), 0, 255).astype(np.uint8)
        return pale


def captioned(canvas: Picture, head: str, text: str) -> Picture:
    """Return a canvas over its caption, words in two sizes.

    A narrow canvas leaves the picture narrower than its words, and gets room on both sides.
    """
    top, width = canvas.shape[0], max(canvas.shape[1], MIN_SIDE_PX)
    verdict, small = wrap(head, width - 20, HEAD_SIZE), wrap(text, width - 20, TEXT_SIZE)
    below = 20 + HEAD_LEADING_PX * len(verdict) + LEADING_PX * len(small)
    left = (width - canvas.shape[1]) // 2
    right = width - canvas.shape[1] - left
    padded = cv2.copyMakeBorder(canvas, 0, below, left, right, cv2.BORDER_CONSTANT, value=PAPER)
    picture = np.asarray(padded, np.uint8)
    write(picture, verdict, (10, top + 24), size=HEAD_SIZE, leading_px=HEAD_LEADING_PX)
    write(picture, small, (10, top + 24 + HEAD_LEADING_PX * len(verdict)))
    return picture


def png(picture: AnyArray) -> bytes:
    """Return a picture as a PNG that says who wrote it, which `output_files.is_ours` looks for."""
    text, stream = PngInfo(), BytesIO()
    text.add_text("Software", SIGNED_BY)
    Image.fromarray(picture).save(stream, "PNG", compress_level=_PNG_EFFORT, pnginfo=text)
    return stream.getvalue()


def draw_line(canvas: Picture, ends: NDArray[np.float64], colour: ArrayLike, thickness: int) -> None:
    """Draw an anti-aliased line with sub-pixel ends, clipped to what OpenCV's integers hold."""
    fixed = np.clip(ends * 2**_SHIFT, -(2**30), 2**30).round().astype(int)
    start, end = fixed.tolist()
    cv2.line(canvas, start, end, np.ravel(colour).tolist(), thickness, cv2.LINE_AA, _SHIFT)


def draw_ring(canvas: Picture, centre: ArrayLike, radius: int, colour: ArrayLike, thickness: int) -> None:
    """Draw an anti-aliased circle on a dark rim."""
    x, y = np.asarray(centre, float).round().astype(int).tolist()
    for tone, width in (((0, 0, 0), thickness + 2), (np.ravel(colour).tolist(), thickness)):
        cv2.circle(canvas, (x, y), radius, tone, width, cv2.LINE_AA)


def write(
    canvas: Picture,
    text: str | Sequence[str],
    at: tuple[int, int],
    *,
    size: float = TEXT_SIZE,
    leading_px: int = LEADING_PX,
) -> None:
    """Write a line, or several below each other; OpenCV's font has ASCII only."""
    for index, line in enumerate([text] if isinstance(text, str) else text):
        printable = line.encode("ascii", "replace").decode()
        place = at[0], at[1] + leading_px * index
        cv2.putText(canvas, printable, place, _FONT, size, INK, 1, cv2.LINE_AA)


def wrap(text: str, width: int, size: float) -> list[str]:
    """Return a sentence broken into lines that are at most ``width`` pixels wide in this font size."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and cv2.getTextSize(longer, _FONT, size, 1)[0][0] > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines
