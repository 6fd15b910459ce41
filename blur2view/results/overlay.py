"""The overlay picture: smears, epipolar lines and certainty of one estimate, drawn with OpenCV alone."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray
from blur2view.geometry.epipolar import epipoles, homogeneous
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.networks.smear_network import rgb_of
from blur2view.results.drawing import FAINT, PAPER, Picture, draw_line, orientation_colours
from blur2view.results.panel import draw_panel
from blur2view.smears.grid import SmearGrid
from blur2view.smears.matches import SmearMatches

# The longer side of the drawn photograph: small ones are enlarged until a smear can be seen, large ones
# reduced so that the file stays a picture to look at.
MIN_SIDE_PX, MAX_SIDE_PX = 640, 1280
SMEAR_SPACING_PX = 26  # at most one smear in a square of this side or more: the photograph stays visible
EPIPOLAR_LINES = 14


def draw_overlay(
    image: AnyArray,
    grid: SmearGrid,
    matches: SmearMatches,
    geometry: TwoViewGeometry,
    exposure_s: float | None = None,
) -> Picture:
    """Return the overlay of an estimate on its photograph.

    Inlier smears are vivid, coloured by orientation; outliers are grey. Where no H explains the smears, too,
    white lines are epipolar lines of F through a spread of inliers, and a ring marks an epipole that lies in
    the picture. The panel below holds the configuration and what it means, the key of the orientation colours
    and a map of sigma.

    Parameters
    ----------
    image : ndarray of shape (H, W, 3) or (H, W)
        The photograph, as it was estimated.
    grid : SmearGrid
        Of the same height and width; its sigma is mapped.
    matches : SmearMatches
        The smears that were used, N.
    geometry : TwoViewGeometry
        Its ``inlier_mask`` and ``swapped`` have N entries.
    exposure_s : float, optional
        Exposure time, with which a rotation is given as an angular velocity.

    Returns
    -------
    ndarray of shape (H', W', 3), uint8
        RGB; the photograph's longer side is 640 to 1280 pixels.

    Raises
    ------
    ValueError
        If the grid is not of the image's size or the masks are not of the matches' length.
    """
    if grid.shape != np.shape(image)[:2]:
        raise ValueError(f"expected a grid of shape {np.shape(image)[:2]}, got {grid.shape}")
    if len(geometry.inlier_mask) != len(matches):
        raise ValueError(f"expected masks of {len(matches)} matches, got {len(geometry.inlier_mask)}")
    canvas = draw_smears(rgb_of(image), matches, geometry)
    panel = draw_panel(max(canvas.shape[1], MIN_SIDE_PX), grid, matches, geometry, exposure_s)
    picture = with_room(canvas, panel.shape[1], panel.shape[0])
    picture[canvas.shape[0] :] = panel
    return picture


def draw_smears(
    image: NDArray[np.float32], matches: SmearMatches, geometry: TwoViewGeometry, longest: int | None = None
) -> Picture:
    """Return the photograph with smears, epipolar lines and epipoles, without the panel.

    As `draw_overlay`; ``longest`` is the longer side of the picture, pixels, by default that of the overlay.
    """
    view = View.of(image.shape, longest)
    canvas = view.backdrop(image)
    typical = float(np.median(matches.length_px)) * view.scale if len(matches) else 0.0
    spacing = max(SMEAR_SPACING_PX, 0.5 * typical)  # long smears need more room
    certainty = matches.length_px / (matches.sigma_px + 0.1)
    shown = spread_subset(view.to_canvas(matches.midpoint), certainty, spacing)
    F = None if geometry.H is not None else geometry.F  # beside H its lines would tell what nothing shows
    if F is not None:
        _draw_epipolar_lines(canvas, view, F, geometry, matches)
    _draw_smears(canvas, view, matches.ends[shown], geometry.inlier_mask[shown])
    if F is not None:
        _draw_epipoles(canvas, view, F)
    return canvas


@dataclass(frozen=True, kw_only=True)
class View:
    """The scale from the photograph to the canvas.

    Parameters
    ----------
    width, height : int
        Size of the canvas in pixels.
    scale : float
        Canvas pixels per pixel of the photograph.
    """

    width: int
    height: int
    scale: float

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

    def resized(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the photograph at this scale."""
        interpolation = cv2.INTER_AREA if self.scale < 1 else cv2.INTER_LINEAR
        small = cv2.resize(image, (self.width, self.height), interpolation=interpolation)
        return small.reshape(self.height, self.width, 3).astype(np.float32, copy=False)

    def backdrop(self, image: NDArray[np.float32]) -> Picture:
        """Return the photograph at this scale, paled and darkened so that colours on it stand out."""
        mixed = np.column_stack([0.4 / 3 + 0.25 * np.eye(3), np.full(3, 0.08)])  # grey, colour and a constant
        pale: Picture = np.clip(cv2.transform(self.resized(image), 255 * mixed), 0, 255).astype(np.uint8)
        return pale


def spread_subset(
    points: NDArray[np.float64], quality: NDArray[np.floating], spacing: float
) -> NDArray[np.intp]:
    """Return the index of the best point (N, 2) in every square of side ``spacing``, in increasing order.

    Larger quality (N,) is better; ties go to the first.
    """
    best_first = np.argsort(-quality, kind="stable")
    squares = np.floor(points[best_first] / spacing).astype(np.int64)
    _, first = np.unique(squares, axis=0, return_index=True)
    return np.sort(best_first[first])


def _draw_smears(
    canvas: Picture, view: View, ends: NDArray[np.float64], inlier_mask: NDArray[np.bool_]
) -> None:
    """Draw smears end to end, outliers first, inliers on a dark rim."""
    colours = orientation_colours(ends[:, 1] - ends[:, 0])
    drawn = view.to_canvas(ends)
    for index in np.flatnonzero(~inlier_mask):
        draw_line(canvas, drawn[index], FAINT, thickness=2)
    for index in np.flatnonzero(inlier_mask):
        draw_line(canvas, drawn[index], (0, 0, 0), thickness=4)
        draw_line(canvas, drawn[index], colours[index], thickness=2)


def _draw_epipolar_lines(
    canvas: Picture, view: View, F: NDArray[np.float64], geometry: TwoViewGeometry, matches: SmearMatches
) -> None:
    """Draw lines F x1 beside the close ends of inliers spread over the photograph, half transparent."""
    inliers = np.flatnonzero(geometry.inlier_mask)
    chosen = inliers[farthest_points(matches.midpoint[inliers], EPIPOLAR_LINES)]
    order = geometry.swapped[chosen].astype(int)
    lines = homogeneous(matches.ends[chosen, order]) @ F.T  # (n, 3)
    norms = np.hypot(lines[:, 0], lines[:, 1])
    layer = canvas.copy()
    for line, close_end in zip(
        lines / np.maximum(norms, 1e-300)[:, None], matches.ends[chosen, 1 - order], strict=True
    ):
        foot = close_end - (line @ [*close_end, 1.0]) * line[:2]
        point, direction = view.to_canvas(foot), np.array([-line[1], line[0]])
        across = (sum(canvas.shape[:2]) + np.abs(point).max()) * direction
        draw_line(layer, np.stack([point - across, point + across]), (255, 255, 255), thickness=1)
    cv2.addWeighted(layer, 0.6, canvas, 0.4, 0, dst=canvas)


def farthest_points(points: NDArray[np.float64], count: int) -> NDArray[np.intp]:
    """Return indices of up to ``count`` points: a central one, then always the farthest from those chosen."""
    if len(points) == 0:
        return np.empty(0, np.intp)
    distance = np.linalg.norm(points - points.mean(axis=0), axis=1)
    chosen = [int(distance.argmin())]
    nearest = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)


def _draw_epipoles(canvas: Picture, view: View, F: NDArray[np.float64]) -> None:
    """Ring the epipoles that lie on the canvas."""
    for epipole in epipoles(F):
        if abs(epipole[2]) < 1e-12:
            continue  # at infinity
        x, y = view.to_canvas(epipole[:2] / epipole[2])
        if 0 <= x < canvas.shape[1] and 0 <= y < canvas.shape[0]:
            for radius, colour, thickness in ((11, (0, 0, 0), 4), (11, (255, 255, 255), 2)):
                cv2.circle(canvas, (round(x), round(y)), radius, colour, thickness, cv2.LINE_AA)


def with_room(canvas: Picture, width: int, below: int) -> Picture:
    """Return a canvas with room below it, and on both sides if a narrow photograph leaves it narrower."""
    left = (width - canvas.shape[1]) // 2
    right = width - canvas.shape[1] - left
    padded = cv2.copyMakeBorder(canvas, 0, below, left, right, cv2.BORDER_CONSTANT, value=PAPER)
    return np.asarray(padded, np.uint8)
