"""The report in headless Chromium: epipolar lines and ends are drawn where F says they are."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from blur2view.camera.camera import Camera
from blur2view.geometry.sampson import sampson
from blur2view.geometry.two_view_geometry import Configuration
from blur2view.results.report import Entry
from tests.support.report_browser import Opener, click_at, numbers, quantised_ends, scale_of, value
from tests.support.report_scenes import HEIGHT, WIDTH, made_up, turning_F


def in_order(F: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Both ends, the one of view 1 first, by the smaller Sampson distance."""
    forward, backward = (sampson(F, *(end[None] for end in pair))[0] for pair in (ends, ends[::-1]))
    return ends if forward <= backward else ends[::-1]


def test_lines_of_a_distorting_lens_are_curves(opened: Opener) -> None:
    camera = Camera.from_string(f"SIMPLE_RADIAL {WIDTH} {HEIGHT} 500 320 180 0.6")
    F, one = turning_F(), made_up(F=turning_F(), camera=camera)
    page = opened(Entry.of(one))
    point = (121, 41)
    click_at(page, point)
    ends = camera.undistorted(quantised_ends(one, *point))
    first, second = in_order(F, ends)
    for mark, line in (("line-1", F.T @ [*second, 1]), ("line-2", F @ [*first, 1])):
        path = page.locator(f"[data-mark={mark}]").get_attribute("d") or ""
        drawn = np.array(numbers(path)).reshape(-1, 2) / scale_of(page) - 0.5
        straight = camera.undistorted(drawn)
        inside = ((drawn > 0) & (drawn < (WIDTH, HEIGHT))).all(axis=1)
        away = abs(np.c_[straight, np.ones(len(straight))] @ line) / math.hypot(*line[:2])
        assert inside.sum() > 40 and away[inside].max() < 1
        ruled = abs(np.c_[drawn, np.ones(len(drawn))] @ line) / math.hypot(*line[:2])
        assert ruled[inside].max() > 2  # as a straight line it would be wrong


@pytest.mark.parametrize("config", [Configuration.DEGENERATE, Configuration.PLANAR, Configuration.PANORAMIC])
def test_without_F_or_beside_a_homography_a_smear_has_ends_and_no_lines(
    opened: Opener, config: Configuration
) -> None:
    F = None if config is Configuration.DEGENERATE else turning_F()
    one = made_up(config=config, F=F, H=None if F is None else np.eye(3))
    page = opened(Entry.of(one))
    click_at(page, (201, 121))
    marks = page.locator("[data-mark]").evaluate_all("(all) => all.map((mark) => mark.dataset.mark)")
    assert sorted(marks) == ["end-1", "end-2", "smear", "smear-halo"]
    if F is None:
        assert value(page, "error") == "-" and value(page, "label") == "-"
