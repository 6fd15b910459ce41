"""Pictures over a photograph, its smears, epipolar lines and motion mask, each a layer; and their captions.

A layer is RGBA of 8 bits, its colours multiplied by its opacity, transparent where nothing is drawn.
"""

import struct
import zlib
from functools import cache
from textwrap import wrap
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont

from blur2view.arrays import TINY, AnyArray, Array
from blur2view.geometry.epipolar import epipoles, homogeneous
from blur2view.images.pixels import as_floats, as_photograph, to_resized
from blur2view.movers.mask import MotionLabel, MotionMask
from blur2view.output import SIGNED_BY
from blur2view.pipeline import Estimate
from blur2view.records.record import Record
from blur2view.records.verdict import fit_line, percent
from blur2view.smears.blur_map import BlurLabel, label_shares

Picture = NDArray[np.uint8]  # (H, W, 3) or, of a layer, (H, W, 4)
INK, PAPER, FAINT, BLACK, WHITE = (235, 235, 235), (26, 26, 30), (165, 165, 165), (0, 0, 0), (255, 255, 255)
PINK = (255, 70, 170)
TEXT_SIZE_PX, HEAD_SIZE_PX, LEADING = 13, 17, 1.3
LETTER = 0.5  # width of a letter over the size of its font, with a margin (bound)
_font = cache(ImageFont.load_default)  # Pillow's own: OpenCV 4 and 5 have different ones
# The longer side of the drawn photograph: small ones are enlarged until a smear can be seen, large ones
# reduced so that the file stays a picture to look at.
MIN_SIDE_PX, MAX_SIDE_PX = 640, 1280
PNG_OPTIONS = [
    cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE,
    cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP,
]  # fmt: skip
PNG_HEADER = 33  # bytes of the signature and of the first chunk, IHDR
_SHIFT = 4  # OpenCV draws with 1/16 px
SMEAR_SPACING_PX = 26  # smallest side of a square with one smear: the photograph stays visible
SQUARES = 14  # of the picture, in each of which the longest smear gets its epipolar line
LINE_OPACITY, MOVING_OPACITY, UNSEEN_OPACITY = 0.6, 0.55, 0.55
HATCH_PX = 12
BLUR_COLOURS = {
    BlurLabel.SHARP: (60, 200, 90),
    BlurLabel.SMEARED: (255, 140, 30),
    BlurLabel.SOFT: (60, 130, 255),
    BlurLabel.SMOOTH: (0, 0, 0),
}
BLUR_OPACITY = 0.35
PALE = np.column_stack([0.4 / 3 + 0.25 * np.eye(3), np.full(3, 20)])
"""Affine map (3, 4) of RGB to paler RGB, on which colours stand out: mean, share of colour, constant."""
MENTIONED_SHARE = 0.005  # of the photograph: a smaller unobservable part is not mentioned


def draw_overlay(image: AnyArray, estimate: Estimate, record: Record | None = None) -> Picture:
    """Return the overlay of an estimate on its photograph.

    Inlier smears are coloured by orientation, outliers grey; smears shorter than their standard deviation are
    not drawn. White lines are epipolar lines of F through a spread of inliers, and rings mark the epipoles,
    unless a homography also explains the smears. The panel below holds the verdict of the record, by default
    that of the estimate.

    Parameters
    ----------
    image : ndarray of shape (H, W, 3) or (H, W)
        The photograph, as it was estimated.
    estimate : Estimate
        The photograph's.
    record : Record, optional
        Its record, from which the panel has the verdict.

    Returns
    -------
    ndarray of shape (H', W', 3), uint8
        RGB; the photograph's longer side becomes 640 to 1280 pixels.

    Raises
    ------
    ValueError
        If the estimate is of a picture of another size.

    Examples
    --------
    >>> import blur2view
    >>> image = blur2view.read_image("models/sample.jpg")
    >>> overlay = blur2view.draw_overlay(image, blur2view.estimate("models/sample.jpg"))
    >>> overlay.shape[1:], overlay.dtype
    ((960, 3), dtype('uint8'))
    """
    if (shape := estimate.grid.shape) != np.shape(image)[:2]:
        raise ValueError(f"expected an estimate of shape {np.shape(image)[:2]}, got {shape}")
    record = record or estimate.record()
    lines, smears = line_layer(estimate), smear_layer(estimate)
    fits, key = bool(estimate.geometry.inlier_mask.any()), list[str]()
    if fits:
        key.append("smears that fit are coloured by their direction")
    if smears.any():
        key.append("others are grey" if fits else "smears are grey")
    if lines.any():
        key.append("white lines are epipolar lines, and rings are epipoles")
    config = f"COLMAP calls it {record.config}" if record.moved() else ""
    text = ". ".join(filter(None, (fit_line(record), config, "; ".join(key).capitalize())))
    pale = np.asarray(cv2.transform(shown(as_photograph(image)), PALE), np.uint8)
    return captioned(over(pale, lines, smears), record.verdict, text)


def draw_motion(image: AnyArray, mask: MotionMask, unseen: str = "") -> Picture:
    """Return the picture of a motion mask over its photograph (H, W, 3), uint8 RGB.

    What moves is pink with a white rim; where motion is unobservable the photograph is dark and hatched.
    ``unseen`` says why the photograph shows nothing, if it does not.
    """
    if mask.labels.shape != image.shape[:2]:
        raise ValueError(f"expected a mask of shape {image.shape[:2]}, got {mask.labels.shape}")
    marked = {
        "what moves is pink": mask.shares["moving"],
        "what is unobservable is hatched": mask.shares["unobservable"],
    }
    text = "; ".join([*(words for words, share in marked.items() if share), mask.reason]).capitalize()
    return captioned(over(shown(image), mask_layer(mask)), mask_verdict(mask, unseen), text)


def draw_blur_map(image: AnyArray, labels: NDArray[np.uint8]) -> Picture:
    """Return the picture of a blur map (`blur_map`) over its photograph (H, W, 3), uint8 RGB.

    What is sharp is green, smeared orange, out of focus blue; where the picture is smooth it is dark.
    ValueError if the map has another shape than the photograph.
    """
    if labels.shape != image.shape[:2]:
        raise ValueError(f"expected a blur map of shape {image.shape[:2]}, got {labels.shape}")
    picture = shown(image)
    size = picture.shape[1], picture.shape[0]
    colours = np.zeros((256, 3), np.uint8)
    colours[list(BLUR_COLOURS)] = list(BLUR_COLOURS.values())
    tint = colours[cv2.resize(labels, size, interpolation=cv2.INTER_NEAREST)]
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)[..., None]
    blended = np.rint((1 - BLUR_OPACITY) * grey + BLUR_OPACITY * tint).astype(np.uint8)
    shares = label_shares(labels)
    words = {"sharp": "sharp (green)", "smeared": "smeared (orange)", "soft": "out of focus (blue)"}
    words["smooth"] = "too smooth to tell (dark)"
    named = [f"{percent(share)} {words[name]}" for name, share in shares.items() if share]
    return captioned(blended, "Blur map", "; ".join(named))


def mask_verdict(mask: MotionMask, unseen: str = "") -> str:
    """Return the shares that move and that are unobservable, as a sentence; ``unseen`` as `draw_motion`."""
    hidden, count = mask.shares["unobservable"], len(mask.regions)
    if unseen and not count:
        return f"{unseen.capitalize()}: cannot tell what moves"
    if hidden == 1:
        return "Motion is unobservable everywhere"
    line = "No mover found"
    if count:
        parts = "1 moving part" if count == 1 else f"{count} moving parts"
        line = f"{parts}, {percent(mask.shares['moving'])} of the photograph"
    if unseen:
        return f"{line}; uncertain, because the photograph is {unseen}"
    return f"{line}; motion is unobservable in {percent(hidden)}" if hidden >= MENTIONED_SHARE else line


def picture_scale(shape: tuple[int, ...]) -> float:
    """Return the scale from a photograph of shape (H, W, ...) to its picture."""
    longer = max(shape[:2])
    return min(max(longer, MIN_SIDE_PX), MAX_SIDE_PX) / longer


def picture_size(shape: tuple[int, ...]) -> tuple[int, int]:
    """Return the width and height of the picture of a photograph of shape (H, W, ...)."""
    return max(round(shape[1] * picture_scale(shape)), 1), max(round(shape[0] * picture_scale(shape)), 1)


def on_picture(points: Array, shape: tuple[int, ...]) -> Array:
    """Return pixels (..., 2) of a photograph as pixels of its picture; the corners coincide."""
    return to_resized(points, picture_scale(shape))


def shown(image: AnyArray) -> Picture:
    """Return the picture of a photograph (H, W, 3) or (H, W), uint8 RGB."""
    interpolation = cv2.INTER_AREA if picture_scale(image.shape) < 1 else cv2.INTER_LINEAR
    small = cv2.resize(image, picture_size(image.shape), interpolation=interpolation)
    if small.dtype == np.uint8 and small.ndim == 3:
        return np.asarray(small, np.uint8)
    return np.round(255 * np.clip(as_floats(small), 0, 1)).astype(np.uint8)


def over(picture: Picture, *layers: Picture) -> Picture:
    """Return a picture (H, W, 3) under layers (H, W, 4), the last on top."""
    pixels = picture.reshape(-1, 3).copy()
    for layer in layers:
        own = layer.reshape(-1, 4)
        drawn = np.flatnonzero(own.view(np.uint32))
        through = 1 - own[drawn, 3:] / np.float32(255)
        pixels[drawn] = np.round(pixels[drawn] * through + own[drawn, :3])
    return pixels.reshape(picture.shape)


def smear_layer(estimate: Estimate) -> Picture:
    """Return the layer of smears that exceed their errors: inliers coloured, on dark rims, above outliers."""
    matches, fits, shape = estimate.matches, estimate.geometry.inlier_mask, estimate.grid.shape
    layer, certainty = blank(shape), matches.length_px / (matches.sigma_px + 0.1)
    typical = float(np.median(matches.length_px)) * picture_scale(shape) if len(matches) else 0.0
    spacing = max(SMEAR_SPACING_PX, 0.5 * typical)  # room for long smears
    spread = spread_subset(on_picture(matches.midpoint, shape), certainty, spacing)
    drawn = spread[certainty[spread] >= 1]
    drawn = drawn[np.argsort(fits[drawn], kind="stable")]
    ends = fixed_point(on_picture(matches.ends[drawn], shape))
    for own, fit, colour in zip(
        ends, fits[drawn], orientation_colours(matches.displacement[drawn]), strict=True
    ):
        if fit:
            draw_line(layer, own, opaque(BLACK), thickness=4)
        draw_line(layer, own, opaque(colour if fit else FAINT), thickness=2)
    return layer


def line_layer(estimate: Estimate) -> Picture:
    """Return the layer of epipolar lines of inliers and of epipoles; empty with H or a distorting lens."""
    matches, geometry, shape = estimate.matches, estimate.geometry, estimate.grid.shape
    layer, F = blank(shape), geometry.F
    if F is None or geometry.H is not None or (estimate.camera is not None and estimate.camera.distorted):
        return layer
    inliers, spacing = np.flatnonzero(geometry.inlier_mask), np.sqrt(np.prod(layer.shape[:2]) / SQUARES)
    spread = spread_subset(on_picture(matches.midpoint[inliers], shape), matches.length_px[inliers], spacing)
    chosen = inliers[spread]
    open_ends = matches.ends[chosen, geometry.second_end_is_open[chosen].astype(int)]
    for line in homogeneous(open_ends) @ F.T:
        a, b, c = line / max(np.hypot(*line[:2]), TINY)
        foot, along = -c * np.array([a, b]), np.array([-b, a])
        reach = (np.abs(foot).sum() + sum(shape)) * along
        ends = fixed_point(on_picture(np.stack([foot - reach, foot + reach]), shape))
        draw_line(layer, ends, opaque(WHITE, LINE_OPACITY), thickness=1)
    for x, y, z in epipoles(F):
        epipole = np.array([x, y]) / (z if abs(z) > TINY else TINY)
        if (epipole >= -0.5).all() and (epipole < np.array(shape[::-1]) - 0.5).all():
            centre = on_picture(epipole, shape).round().astype(int).tolist()
            for colour, thickness in ((BLACK, 4), (WHITE, 2)):
                cv2.circle(layer, centre, 11, opaque(colour), thickness, cv2.LINE_AA)
    return layer


def mask_layer(mask: MotionMask) -> Picture:
    """Return the layer of a motion mask: moving parts pink with a white rim, unobservable ones hatched."""
    shape = mask.labels.shape
    layer, labels = (
        blank(shape),
        cv2.resize(mask.labels, picture_size(shape), interpolation=cv2.INTER_NEAREST),
    )
    moving, unseen = labels == MotionLabel.MOVING, labels == MotionLabel.UNOBSERVABLE
    rows, columns = np.indices(labels.shape)
    layer[unseen] = opaque(BLACK, UNSEEN_OPACITY)
    layer[unseen & ((rows + columns) % HATCH_PX == 0)] = opaque(FAINT)
    layer[moving] = opaque(PINK, MOVING_OPACITY)
    rims, _ = cv2.findContours(moving.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(layer, rims, -1, opaque(WHITE), 1, cv2.LINE_AA)
    return layer


def blank(shape: tuple[int, ...]) -> Picture:
    """Return a transparent layer for a photograph of shape (H, W, ...)."""
    width, height = picture_size(shape)
    return np.zeros((height, width, 4), np.uint8)


def opaque(colour: ArrayLike, opacity: float = 1.0) -> list[float]:
    """Return the RGBA value of a colour with an opacity in a layer."""
    return [round(opacity * value) for value in (*np.ravel(colour).tolist(), 255)]


def spread_subset(points: Array, quality: NDArray[np.floating], spacing: float) -> NDArray[np.intp]:
    """Return the indices, increasing, of the best point (N, 2) in every square of side ``spacing``."""
    best_first = np.argsort(-quality, kind="stable")
    squares = np.floor(points[best_first] / spacing).astype(np.int64)
    _, first = np.unique(squares, axis=0, return_index=True)
    return np.sort(best_first[first])


def orientation_colours(displacement: Array) -> Picture:
    """Return colours (N, 3) by the orientation of smears d (N, 2), the same for d and -d."""
    hsv = np.full((len(displacement), 1, 3), 190, np.uint8)  # a little pale: full blue would be dark
    degrees = np.degrees(np.arctan2(displacement[:, 1], displacement[:, 0])) % 180
    hsv[:, 0, 0], hsv[:, 0, 2] = degrees.astype(np.uint8) % 180, 255  # OpenCV's hue is 0 to 179
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB) if len(hsv) else hsv, np.uint8)[:, 0]


def fixed_point(ends: Array) -> list[Any]:
    """Return sub-pixel ends (..., 2, 2) as lists of 1/16 px, clipped to the range of OpenCV's integers."""
    return list(np.clip(ends * 2**_SHIFT, -(2**30), 2**30).round().astype(int).tolist())


def draw_line(layer: Picture, ends: list[Any], colour: list[float], thickness: int) -> None:
    """Draw an anti-aliased line of a colour (4,) between ends in `fixed_point`."""
    start, end = ends
    cv2.line(layer, start, end, colour, thickness, cv2.LINE_AA, _SHIFT)


def captioned(picture: Picture, head: str, text: str) -> Picture:
    """Return a picture above its caption, a head and a text; a narrow one gets margins."""
    (height, shown_px), width = picture.shape[:2], max(picture.shape[1], MIN_SIDE_PX)
    lines = []
    for words, size in ((head, HEAD_SIZE_PX), (text, TEXT_SIZE_PX)):
        lines += [(line, size) for line in wrap(words, int((width - 20) / (LETTER * size)))]
    below = 20 + sum(round(LEADING * size) for _, size in lines)
    page = Image.new("RGB", (width, height + below), PAPER)
    page.paste(Image.fromarray(picture), ((width - shown_px) // 2, 0))
    pen, base = ImageDraw.Draw(page), height + 2
    for line, size in lines:
        base += round(LEADING * size)
        printable = line.encode("utf-8", "replace").decode()  # a file name may hold bytes that are no text
        pen.text((10, base), printable, INK, _font(size), anchor="ls")
    return np.array(page)


def png(picture: AnyArray) -> bytes:
    """Return a picture (H, W), (H, W, 3) or (H, W, 4), uint8, as PNG, signed for `output.is_ours`.

    Of an overlay of 1280x1019 pixels it takes half the time of Pillow's lowest effort, for 11 % more bytes:
    all rows have one filter, and only runs of one value are looked for.
    """
    order = {3: cv2.COLOR_RGB2BGR, 4: cv2.COLOR_RGBA2BGRA}
    pixels = cv2.cvtColor(picture, order[picture.shape[2]]) if picture.ndim == 3 else picture
    content = cv2.imencode(".png", pixels, PNG_OPTIONS)[1].tobytes()
    text = b"tEXtSoftware\0" + SIGNED_BY.encode()
    chunk = struct.pack(">I", len(text) - 4) + text + struct.pack(">I", zlib.crc32(text))
    return content[:PNG_HEADER] + chunk + content[PNG_HEADER:]
