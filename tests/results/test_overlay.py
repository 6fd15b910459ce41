"""The overlay: its parts are where the geometry says, at every size of photograph."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from blur2view.geometry.epipolar import cross_matrix, fundamental_from_pose
from blur2view.geometry.two_view_geometry import Configuration, TwoViewGeometry
from blur2view.results.mask_overlay import mask_verdict
from blur2view.results.overlay import draw_overlay
from blur2view.segmentation.mask import MotionLabel
from blur2view.segmentation.pixels import MovingRegion
from blur2view.smears.field import smear_ends
from blur2view.smears.grid import SmearGrid
from blur2view.smears.matches import SmearMatches
from tests.support.grids import grid_of
from tests.support.report_scenes import boxed_mask

SIDEWAYS = cross_matrix(np.array([1.0, 0.0, 0.0])) / 2**0.5  # camera moving along x: horizontal lines


PHOTO = np.full((480, 640, 3), 0.5, np.float32)


def blank_grid(shape: tuple[int, ...]) -> SmearGrid:
    cells = -(-shape[0] // 32), -(-shape[1] // 32)
    return grid_of(np.zeros((*cells, 2)), 1.0, stride=32, shape=(shape[0], shape[1]))


def matches_at(
    points: list[tuple[float, float]], displacement: tuple[float, float] = (12, 0)
) -> SmearMatches:
    ends = smear_ends(np.reshape(points, (-1, 2)), np.full((len(points), 2), displacement))
    return SmearMatches(ends=ends, sigma_px=np.ones(len(points)))


def geometry_of(inliers: list[bool], F: NDArray[np.float64] | None = None) -> TwoViewGeometry:
    return TwoViewGeometry(
        F=F,
        config=Configuration.DEGENERATE if F is None else Configuration.UNCALIBRATED,
        reason="the figures that decided",
        inlier_mask=np.array(inliers, bool),
        swapped=np.zeros(len(inliers), bool),
    )


def drawn(
    points: list[tuple[float, float]],
    inliers: list[bool],
    F: NDArray[np.float64] | None = None,
    displacement: tuple[float, float] = (12, 0),
) -> NDArray[np.uint8]:
    """Return the overlay of smears at points of a grey photograph of 640x480."""
    matches = matches_at(points, displacement)
    return draw_overlay(PHOTO, blank_grid(PHOTO.shape), matches, geometry_of(inliers, F))


def test_epipolar_lines_run_through_inliers_alone_along_F() -> None:
    points: list[tuple[float, float]] = [(100, 60), (300, 240), (500, 400)]
    with_F, without = (drawn(points, [True] * 3, F) for F in (SIDEWAYS, None))
    changed = (with_F[:480] != without[:480]).any(-1)
    rows = np.flatnonzero(changed.mean(axis=1) > 0.9)
    assert all(abs(rows - y).min() <= 1 for y in (60, 240, 400))
    assert all(abs(np.array([60, 240, 400]) - row).min() <= 1 for row in rows)
    outlier = drawn([(100, 60)], [False], SIDEWAYS)
    assert (outlier[60, 200:] == outlier[0, 0]).all()


@pytest.mark.parametrize("swapped", [False, True])
def test_epipolar_line_is_that_of_the_open_end_in_the_close_view(swapped: bool) -> None:
    K = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])
    R, t = np.eye(3), np.array([0.1, 0.0, 0.0])
    R[:2, :2] = [[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]]
    F = fundamental_from_pose(K, R, t)
    ray = np.array([0.0, 0.2, 1.0])
    open_end, close_end = ((K @ point)[:2] / (K @ point)[2] for point in (ray, R @ ray + t))
    line = F @ [*open_end, 1.0]  # rolled against the lines F^T x2 by 17 degrees
    ends = np.stack([close_end, open_end] if swapped else [open_end, close_end])[None]
    matches = SmearMatches(ends=ends, sigma_px=np.ones(1))
    geometry = replace(geometry_of([True], F), swapped=np.array([swapped]))
    picture = draw_overlay(PHOTO, blank_grid(PHOTO.shape), matches, geometry)
    columns = np.array([20, 60, 580, 620])
    rows = np.round(-(line[0] * columns + line[2]) / line[1]).astype(int)
    inside = (rows > 2) & (rows < 477)
    assert inside.sum() >= 2
    for column, row in zip(columns[inside], rows[inside], strict=True):
        assert picture[row - 1 : row + 2, column].max() > picture[2, 2].max() + 30


@pytest.mark.parametrize(
    ("still", "moving", "expected"),
    [
        (100, 0, "no mover found"),
        (22, 0, "motion is unobservable in 78%; elsewhere no mover found"),
        (0, 0, "motion is unobservable everywhere"),
        (18, 4, "motion is unobservable in 78%; elsewhere 1 moving part, 4.0% of the photograph"),
    ],
)
def test_caption_of_a_mask_counts_what_there_is_and_says_first_that_most_cannot_be_judged(
    still: float, moving: float, expected: str
) -> None:
    labels = np.full((100, 100), MotionLabel.UNOBSERVABLE, np.uint8)
    labels.flat[: round(100 * (still + moving))] = MotionLabel.STATIC
    labels.flat[: round(100 * moving)] = MotionLabel.MOVING
    one = MovingRegion(area_px=1, box=(0, 0, 1, 1), centroid=(0.0, 0.0), probability=1.0)
    assert mask_verdict(replace(boxed_mask(), labels=labels, regions=(one,) * bool(moving))) == expected


def test_sizes_that_disagree_are_refused() -> None:
    for photo, shape in ((PHOTO, (640, 480)), ("a.jpg", (480, 640))):
        with pytest.raises(ValueError, match="expected a grid of shape"):
            draw_overlay(photo, blank_grid(shape), matches_at([]), geometry_of([]))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="masks of 1 matches, got 2"):
        drawn([(8, 8)], [True, True])
