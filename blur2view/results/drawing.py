"""Drawing primitives on RGB pictures: lines, text, colours."""

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

Picture = NDArray[np.uint8]  # (H, W, 3), RGB
INK, PAPER, FAINT = (235, 235, 235), (26, 26, 30), (165, 165, 165)
TEXT_SIZE, LEADING_PX = 0.42, 17
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_SHIFT = 4  # OpenCV draws with 1/16 px


def orientation_colours(displacement: NDArray[np.floating]) -> Picture:
    """Return a vivid colour (N, 3), uint8 RGB, for the orientation of smears (N, 2), the same for d and -d.

    Horizontal is red; the hue goes once around over 180 degrees.
    """
    if len(displacement) == 0:
        return np.empty((0, 3), np.uint8)  # which OpenCV refuses to convert
    degrees = np.degrees(np.arctan2(displacement[..., 1], displacement[..., 0])) % 180
    hsv = np.full((len(degrees), 1, 3), 255, np.uint8)
    hsv[:, 0, 0] = degrees.astype(np.uint8) % 180  # OpenCV's hue is 0 to 179
    hsv[:, 0, 1] = 190  # a little pale: full blue would be dark
    return cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[:, 0].astype(np.uint8)


def draw_line(canvas: Picture, ends: NDArray[np.float64], colour: ArrayLike, thickness: int) -> None:
    """Draw an anti-aliased line with sub-pixel ends, clipped to what OpenCV's integers hold."""
    fixed = np.clip(ends * 2**_SHIFT, -(2**30), 2**30).round().astype(int)
    start, end = fixed.tolist()
    cv2.line(canvas, start, end, np.ravel(colour).tolist(), thickness, cv2.LINE_AA, _SHIFT)


def write(
    canvas: Picture,
    text: str,
    at: tuple[int, int],
    *,
    size: float = TEXT_SIZE,
    colour: tuple[int, int, int] = INK,
    thickness: int = 1,
) -> None:
    """Write one line; OpenCV's font has ASCII only."""
    printable = text.encode("ascii", "replace").decode()
    cv2.putText(canvas, printable, at, _FONT, size, colour, thickness, cv2.LINE_AA)


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


def heat_colours(share: NDArray[np.floating]) -> Picture:
    """Return the colours, RGB, of a map (h, w) of shares 0 to 1."""
    levels = np.round(255 * np.clip(share, 0, 1)).astype(np.uint8)
    return np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS)[..., ::-1], np.uint8)
