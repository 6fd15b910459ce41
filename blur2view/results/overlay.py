"""The overlay pictures, smears and epipolar lines of an estimate, a motion mask, each over its caption."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from io import BytesIO

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont
from PIL.PngImagePlugin import PngInfo

from blur2view.arrays import TINY, AnyArray, Array
from blur2view.geometry.epipolar import epipoles, homogeneous
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.movers.mask import MotionLabel, MotionMask
from blur2view.networks.smear_network import floats_of, photograph_of
from blur2view.output_files import SIGNED_BY
from blur2view.pipeline import Estimate
from blur2view.results.photograph import Photograph
from blur2view.results.verdict import fit_line
from blur2view.smears.matches import SmearMatches

Picture = NDArray[np.uint8]  # (H, W, 3), RGB
INK, PAPER, FAINT = (235, 235, 235), (26, 26, 30), (165, 165, 165)
TEXT_SIZE_PX, LEADING_PX = 13, 17
HEAD_SIZE_PX, HEAD_LEADING_PX = 17, 22  # of the verdict
# The longer side of the drawn photograph: small ones are enlarged until a smear can be seen, large ones
# reduced so that the file stays a picture to look at.
MIN_SIDE_PX, MAX_SIDE_PX = 640, 1280
# Pictures are for looking at: the fastest deflate takes two thirds of the time of 3 of 9, for 5 % more bytes.
_PNG_EFFORT = 1
_SHIFT = 4  # OpenCV draws with 1/16 px
SMEAR_SPACING_PX = 26  # at most one smear in a square of this side or more: the photograph stays visible
SQUARES = 14  # of the picture, in each of which the longest smear gets its epipolar line
AT_INFINITY = 1e-12  # third coordinate, of a unit vector, of an epipole that is at infinity
PINK = (255, 70, 170)
COVER = 0.55  # share of the pink over what moves: the object stays visible
HATCH_PX = 12
LEAST_SHARE = 0.005  # of the photograph that is worth a word: less is 0 %


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


def draw_overlay(image: AnyArray, estimate: Estimate, one: Photograph | None = None) -> Picture:
    """Return the overlay of an estimate on its photograph.

    Inlier smears are vivid, coloured by orientation; outliers are grey; those no longer than their standard
    deviation are thin, and not drawn where nothing explains the others. Where no H explains the smears, too,
    white lines are epipolar lines of F through a spread of inliers, and rings mark the epipoles that lie in
    the picture. The panel below holds the verdict, the configuration, how many smears fit
    and what the lines are.

    Parameters
    ----------
    image : ndarray of shape (H, W, 3) or (H, W)
        The photograph, as it was estimated.
    estimate : Estimate
    one : Photograph, optional
        Its record, whose verdict the panel has; by default that of the estimate alone.

    Returns
    -------
    ndarray of shape (H', W', 3), uint8
        RGB; the photograph's longer side is 640 to 1280 pixels.

    Raises
    ------
    ValueError
        If the estimate is of a photograph of another size.
    """
    if (shape := estimate.grid.shape) != np.shape(image)[:2]:
        raise ValueError(f"expected an estimate of shape {np.shape(image)[:2]}, got {shape}")
    one = one or Photograph.of(estimate, name="")
    canvas = draw_smears(photograph_of(image), estimate)
    return captioned(canvas, one.verdict, f"{fit_line(one)} (COLMAP: {one.config}). {_legend(estimate)}")


def _legend(estimate: Estimate) -> str:
    """Return what the lines of an overlay are, of those that it has."""
    geometry, F, sure = estimate.geometry, lines_of(estimate.geometry), certainty_of(estimate.matches) >= 1
    explained = geometry.F is not None or geometry.H is not None
    fits, drawn = geometry.inlier_mask, drawn_smears(estimate)
    words = ["coloured by direction: smears that fit"] * bool((fits & drawn).any())
    words += ["grey: smears that do not fit" if explained else "grey: smears"] * bool((~fits & drawn).any())
    words += ["thin: no longer than their errors"] * bool((~sure & drawn).any())
    words += ["white: epipolar lines"] * (F is not None and bool(fits.any()))
    words += ["rings: epipoles"] * (F is not None and bool(epipoles_within(F, estimate.grid.size)))
    return "; ".join(words).capitalize()


def draw_smears(image: AnyArray, estimate: Estimate, longest: int | None = None) -> Picture:
    """Return the photograph with smears, epipolar lines and epipoles, without the panel.

    As `draw_overlay`; ``longest`` is the longer side of the picture, pixels, by default that of the overlay.
    """
    matches, geometry, view = estimate.matches, estimate.geometry, View.of(image.shape, longest)
    canvas = view.backdrop(image)
    typical = float(np.median(matches.length_px)) * view.scale if len(matches) else 0.0
    spacing = max(SMEAR_SPACING_PX, 0.5 * typical)  # long smears need more room
    certainty = certainty_of(matches)
    shown = spread_subset(view.to_canvas(matches.midpoint), certainty, spacing)
    shown, sure = shown[drawn_smears(estimate)[shown]], certainty >= 1
    F = lines_of(geometry)
    if F is not None:
        _draw_epipolar_lines(canvas, view, F, geometry, matches)
    _draw_smears(canvas, view, matches.ends[shown], geometry.inlier_mask[shown], sure[shown])
    if F is not None:
        for epipole in epipoles_within(F, estimate.grid.size):
            draw_ring(canvas, view.to_canvas(epipole), 11, (255, 255, 255), thickness=2)
    return canvas


def lines_of(geometry: TwoViewGeometry) -> Array | None:
    """Return the F (3, 3) whose epipolar lines are drawn: beside H they would say what nothing shows."""
    return geometry.F if geometry.H is None else None


def epipoles_within(F: Array, size: tuple[int, int]) -> list[Array]:
    """Return the epipoles (2,) of F that lie in a picture of this width and height, pixels."""
    finite = [one[:2] / one[2] for one in epipoles(F) if abs(one[2]) > AT_INFINITY]
    return [one for one in finite if (one >= -0.5).all() and (one < np.array(size) - 0.5).all()]


def epipolar_lines(
    F: Array, matches: SmearMatches, second_end_is_open: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Return lines F x1 of matches: the points (N, 2) nearest to their close ends, directions (N, 2)."""
    index, order = np.arange(len(matches)), second_end_is_open.astype(int)
    lines = homogeneous(matches.ends[index, order]) @ F.T  # (N, 3)
    lines /= np.maximum(np.hypot(lines[:, 0], lines[:, 1]), TINY)[:, None]
    close_ends = matches.ends[index, 1 - order]
    away = (lines * homogeneous(close_ends)).sum(axis=1, keepdims=True)
    return close_ends - away * lines[:, :2], np.column_stack([-lines[:, 1], lines[:, 0]])


def drawn_smears(estimate: Estimate) -> NDArray[np.bool_]:
    """Return which smears (N,) are drawn: where nothing explains them, those longer than their deviation."""
    explained = estimate.geometry.F is not None or estimate.geometry.H is not None
    return np.asarray((certainty_of(estimate.matches) >= 1) | explained)


def certainty_of(matches: SmearMatches) -> Array:
    """Return the lengths of smears (N,) over their standard deviations."""
    return np.asarray(matches.length_px / (matches.sigma_px + 0.1))


def spread_subset(points: Array, quality: NDArray[np.floating], spacing: float) -> NDArray[np.intp]:
    """Return the index of the best point (N, 2) in every square of side ``spacing``, in increasing order.

    Larger quality (N,) is better; ties go to the first.
    """
    best_first = np.argsort(-quality, kind="stable")
    squares = np.floor(points[best_first] / spacing).astype(np.int64)
    _, first = np.unique(squares, axis=0, return_index=True)
    return np.sort(best_first[first])


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


def _draw_smears(
    canvas: Picture, view: View, ends: Array, inlier_mask: NDArray[np.bool_], sure: NDArray[np.bool_]
) -> None:
    """Draw smears end to end, outliers first, inliers on a dark rim; thin and without one where not sure."""
    colours = orientation_colours(ends[:, 1] - ends[:, 0])
    drawn = view.to_canvas(ends)
    for index in np.flatnonzero(~inlier_mask):
        draw_line(canvas, drawn[index], FAINT, thickness=1 + sure[index])
    for index in np.flatnonzero(inlier_mask):
        if sure[index]:
            draw_line(canvas, drawn[index], (0, 0, 0), thickness=4)
        draw_line(canvas, drawn[index], colours[index], thickness=1 + sure[index])


def _draw_epipolar_lines(
    canvas: Picture, view: View, F: Array, geometry: TwoViewGeometry, matches: SmearMatches
) -> None:
    """Draw the epipolar lines of inliers spread over the photograph, half transparent."""
    inliers = np.flatnonzero(geometry.inlier_mask)
    points, spacing = view.to_canvas(matches.midpoint[inliers]), np.sqrt(view.width * view.height / SQUARES)
    chosen = inliers[spread_subset(points, matches.length_px[inliers], spacing)]
    feet, along = epipolar_lines(F, matches.subset(chosen), geometry.second_end_is_open[chosen])
    feet = view.to_canvas(feet)
    reach = (sum(canvas.shape[:2]) + np.abs(feet).max(axis=1, keepdims=True)) * along
    layer = canvas.copy()
    for ends in np.stack([feet - reach, feet + reach], axis=1):
        draw_line(layer, ends, (255, 255, 255), thickness=1)
    cv2.addWeighted(layer, 0.6, canvas, 0.4, 0, dst=canvas)


def draw_motion(image: AnyArray, mask: MotionMask) -> Picture:
    """Return the picture of a motion mask over its photograph (H, W, 3), as uint8 RGB.

    What moves is pink with a white rim; where motion is unobservable the photograph is dark and hatched. A
    caption below says how much moves, what the colours mean and what was measured. The photograph's longer
    side becomes 640 to 1280 pixels.
    """
    if mask.labels.shape != image.shape[:2]:
        raise ValueError(f"expected a mask of shape {image.shape[:2]}, got {mask.labels.shape}")
    view = View.of(image.shape)
    canvas = view.picture(image)
    labels = cv2.resize(mask.labels, (view.width, view.height), interpolation=cv2.INTER_NEAREST)
    moving, unseen = labels == MotionLabel.MOVING, labels == MotionLabel.UNOBSERVABLE
    canvas[unseen] = (0.45 * canvas[unseen]).astype(np.uint8)
    rows, columns = np.indices(labels.shape)
    canvas[unseen & ((rows + columns) % HATCH_PX == 0)] = FAINT
    canvas[moving] = ((1 - COVER) * canvas[moving] + COVER * np.array(PINK)).astype(np.uint8)
    rims, _ = cv2.findContours(moving.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(canvas, rims, -1, (255, 255, 255), 1, cv2.LINE_AA)
    drawn = ["pink moves"] * bool(rims) + ["hatched is unobservable"] * bool(unseen.any())
    words = "; ".join([*filter(None, [", ".join(drawn)]), mask.reason])
    return captioned(canvas, mask_verdict(mask), words)


def mask_verdict(mask: MotionMask) -> str:
    """Return how much moves and how much is unobservable, as a sentence; if that is most, it comes first."""
    moving, unseen = (
        float((mask.labels == k).mean()) for k in (MotionLabel.MOVING, MotionLabel.UNOBSERVABLE)
    )
    if unseen == 1:
        return "Motion is unobservable everywhere"
    count = len(mask.regions)
    share = f"{moving:.1%}" if moving >= 0.001 else "under 0.1%"
    parts = f"{count} moving part{'s' if count > 1 else ''}, {share} of the photograph"
    moves = parts if count else "no mover found"
    if unseen < LEAST_SHARE:
        return moves[0].upper() + moves[1:]
    hidden = f"motion is unobservable in {min(round(100 * unseen), 99)}%"  # all is another line
    line = f"{moves}; {hidden}" if unseen <= 0.5 else f"{hidden}; elsewhere {moves}"
    return line[0].upper() + line[1:]


def captioned(canvas: Picture, head: str, text: str) -> Picture:
    """Return a canvas over its caption, words in two sizes.

    A narrow canvas leaves the picture narrower than its words, and gets room on both sides.
    """
    top, width = canvas.shape[0], max(canvas.shape[1], MIN_SIDE_PX)
    verdict, small = wrap(head, width - 20, HEAD_SIZE_PX), wrap(text, width - 20, TEXT_SIZE_PX)
    below = 20 + HEAD_LEADING_PX * len(verdict) + LEADING_PX * len(small)
    left = (width - canvas.shape[1]) // 2
    right = width - canvas.shape[1] - left
    padded = cv2.copyMakeBorder(canvas, 0, below, left, right, cv2.BORDER_CONSTANT, value=PAPER)
    picture = np.asarray(padded, np.uint8)
    write(picture, verdict, (10, top + 24), size_px=HEAD_SIZE_PX, leading_px=HEAD_LEADING_PX)
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
    size_px: int = TEXT_SIZE_PX,
    leading_px: int = LEADING_PX,
) -> None:
    """Write a line, or several below each other, with the left end of the first one's base at ``at``."""
    page = Image.fromarray(canvas)
    pen = ImageDraw.Draw(page)
    for index, line in enumerate([text] if isinstance(text, str) else text):
        printable = line.encode("utf-8", "replace").decode()  # a file name may hold bytes that are no text
        pen.text((at[0], at[1] + leading_px * index), printable, INK, _font(size_px), anchor="ls")
    canvas[:] = np.asarray(page)


@cache
def _font(size_px: int) -> ImageFont.FreeTypeFont:
    """Return Pillow's own font: OpenCV 4 and 5 have different ones, whose brackets look like braces."""
    font = ImageFont.load_default(size_px)
    assert isinstance(font, ImageFont.FreeTypeFont)
    return font.font_variant(layout_engine=ImageFont.Layout.BASIC)  # Raqm is not everywhere


def wrap(text: str, width: int, size_px: int) -> list[str]:
    """Return a sentence broken into lines that are at most ``width`` pixels wide in this font size."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and _font(size_px).getlength(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines
