"""The overlay: its parts are where the geometry says, at every size of photograph."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from blur2view.geometry.configuration import Configuration
from blur2view.geometry.epipolar import fundamental_from_pose
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.output import is_ours
from blur2view.pipeline import Estimate
from blur2view.results.overlay import draw_overlay, png
from blur2view.smears.camera_motion import blur_of
from blur2view.smears.matches import SmearMatches
from tests.support.grids import grid_of

PHOTO = np.full((480, 640, 3), 0.5, np.float32)


def drawn(ends: NDArray[np.float64], fits: bool, F: NDArray[np.float64], swapped: bool) -> NDArray[np.uint8]:
    """Return the overlay of smears (N, 2, 2) on a photograph of 640x480."""
    grid = grid_of(np.zeros((15, 20, 2)), 1.0, stride=32, shape=(480, 640))
    geometry = TwoViewGeometry(
        F=F,
        config=Configuration.UNCALIBRATED,
        inlier_mask=np.full(len(ends), fits),
        second_end_is_open=np.full(len(ends), swapped),
    )
    matches = SmearMatches(ends=ends, sigma_px=np.ones(len(ends)))
    one = Estimate(grid=grid, blur=blur_of(grid), matches=matches, geometry=geometry, model_id="made-up")
    with pytest.raises(ValueError, match="expected an estimate of shape"):
        draw_overlay(PHOTO[:, :480], one)
    return draw_overlay(PHOTO, one)


@pytest.mark.parametrize("swapped", [False, True])
def test_epipolar_line_of_an_inlier_is_that_of_its_open_end_in_the_close_view(swapped: bool) -> None:
    K = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])
    R, t = np.eye(3), np.array([0.1, 0.0, 0.0])
    R[:2, :2] = [[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]]
    F, ray = fundamental_from_pose(K, R, t), np.array([0.2, -0.1, 1.0])
    open_end, close_end = ((K @ point)[:2] / (K @ point)[2] for point in (ray, R @ ray + t))
    ends = np.stack([close_end, open_end] if swapped else [open_end, close_end])[None]
    outlier = drawn(ends, False, F, swapped)
    picture, line = drawn(ends, True, F, swapped), F @ [*open_end, 1.0]  # 17 degrees from the lines F^T x2
    columns = np.array([20, 60, 580, 620])
    rows = np.round(-(line[0] * columns + line[2]) / line[1]).astype(int)
    inside = (rows > 2) & (rows < 477)
    assert inside.sum() >= 2
    for column, row in zip(columns[inside], rows[inside], strict=True):
        assert picture[row - 1 : row + 2, column].max() > picture[2, 2].max() + 30
        assert (outlier[row, column] == outlier[2, 2]).all()  # no line


@pytest.mark.parametrize("shape", [(1, 1), (5, 7), (5, 7, 3), (5, 7, 4)])
def test_png_holds_a_picture_as_it_is_and_is_signed(shape: tuple[int, ...], tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    (tmp_path / "a.png").write_bytes(png(picture))
    with Image.open(tmp_path / "a.png") as read:
        read.verify()  # also the checksums
    with Image.open(tmp_path / "a.png") as read:
        np.testing.assert_array_equal(np.asarray(read), picture)
    assert is_ours(tmp_path / "a.png")
