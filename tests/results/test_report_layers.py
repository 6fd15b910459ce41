"""The report in headless Chromium: layers and values are those of the estimate; mouse and keys."""

import numpy as np
import pytest
from playwright.sync_api import Page

from blur2view.geometry.sampson import serrmin
from blur2view.results.report import Entry
from tests.support.report_browser import Opener, numbers, quantised_ends, scale_of, value
from tests.support.report_scenes import HEIGHT, WIDTH, boxed_mask, made_up, turning_F
from tools.reports.report_screenshot import settle


def test_hover_tells_the_values_of_the_estimate(opened: Opener) -> None:
    F, one = turning_F(), made_up(F=turning_F())
    page, field_ = opened(Entry.of(one, boxed_mask())), one.estimate.grid.at_pixels()
    cells = (one.estimate.matches.midpoint // 32).astype(int).tolist()
    used = dict(zip(map(tuple, cells), one.estimate.geometry.inlier_mask.tolist(), strict=True))
    unused = next(cell for cell in np.ndindex(WIDTH // 32, HEIGHT // 32) if cell not in used)
    nodes = [(32 * cell[0] + 21, 32 * cell[1] + 9) for cell in (unused, *list(used)[:3])]
    inside, right = (153, 101), (609, 201)
    for x, y in [inside, right, *nodes]:
        scale = scale_of(page)
        page.locator("#stage").hover(position={"x": (x + 1.4) * scale, "y": (y - 0.4) * scale})
        d, ends = field_.displacement[y, x], quantised_ends(one, x, y)

        def shown(key: str) -> list[float]:
            return numbers(value(page, key, "pointer"))

        assert shown("position") == [x, y]
        assert shown("displacement") == pytest.approx(d.tolist(), abs=0.02)
        assert shown("length") == pytest.approx([np.hypot(*d)], abs=0.02)
        assert shown("direction") == pytest.approx([np.degrees(np.arctan2(d[1], d[0]))], abs=0.1)
        assert shown("sigma") == pytest.approx([field_.sigma_px[y, x]], abs=0.02)
        assert shown("sigma-direction") == pytest.approx([np.degrees(field_.sigma_rad[y, x])], abs=0.1)
        assert shown("error") == pytest.approx(np.sqrt(serrmin(F, ends[None])), abs=0.006)
        label = "moving" if (x, y) == inside else ("unobservable" if x >= 480 else "static")
        assert value(page, "label", "pointer") == label
        assert shown("probability") == [0.9 if (x, y) == inside else 0.1]
        words = {True: "inlier", False: "outlier", None: "not used"}
        assert value(page, "used", "pointer") == words[used.get((x // 32, y // 32))]
    page.mouse.move(2, 2)
    assert value(page, "length", "pointer") == "-"


def focus_stage(page: Page) -> None:
    """Reach the stage with the Tab key alone."""
    for _ in range(30):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.id") == "stage":
            return
    raise AssertionError("the stage cannot be reached with the keyboard")


def test_keyboard_chooses_moves_zooms_and_lets_go(opened: Opener) -> None:
    page = opened(Entry.of(made_up(F=turning_F())))
    focus_stage(page)
    page.keyboard.press("ArrowRight")
    x, y = numbers(value(page, "position"))
    assert abs(x - WIDTH / 2) < 5 and abs(y - HEIGHT / 2) < 5
    page.keyboard.press("ArrowUp")
    moved = numbers(value(page, "position"))
    assert moved[0] == x and 8 <= y - moved[1] <= 32
    assert f"Smear at {moved[0]:.0f}, {moved[1]:.0f}: length" in page.locator("#spoken").inner_text()
    page.keyboard.press("+")
    settle(page)
    assert "stage-zoomed" in (page.locator("#stage").get_attribute("class") or "")
    page.keyboard.press("0")
    settle(page)
    assert "stage-zoomed" not in (page.locator("#stage").get_attribute("class") or "")
    page.keyboard.press("Escape")
    settle(page)
    assert value(page, "position") == "-" and page.locator("[data-mark]").count() == 0
