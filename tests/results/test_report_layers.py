"""The report in headless Chromium: layers and values are those of the estimate; mouse and keys."""

import colorsys
import math

import numpy as np
import pytest
from playwright.sync_api import Page

from blur2view.geometry.sampson import serrmin
from blur2view.results.mask_overlay import headline
from blur2view.results.report import Entry
from tests.support.report_browser import (
    Opener,
    click_at,
    near,
    numbers,
    quantised_ends,
    scale_of,
    settle,
    stage_pixels,
    toggle,
    value,
)
from tests.support.report_scenes import HEIGHT, MOVING_BOX, WIDTH, boxed_mask, made_up, turning_F


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


@pytest.mark.parametrize("width", [1400, 1000])
def test_no_value_of_a_long_smear_runs_past_the_edge(opened: Opener, width: int) -> None:
    page = opened(Entry.of(made_up(F=turning_F()), boxed_mask()), size=(width, 900))
    fill = "(cells) => cells.forEach((cell) => { cell.textContent = '±(-1434.5, -1204.4)' })"
    page.locator("[data-value=displacement]").evaluate_all(fill)
    past = "(cells) => cells.filter((one) => one.scrollWidth > one.clientWidth).map((one) => one.innerText)"
    assert page.locator("#values td, #values th, .matrix td, .pairs dd").evaluate_all(past) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_layers_can_be_toggled(opened: Opener) -> None:
    page = opened(Entry.of(made_up(F=turning_F()), boxed_mask()))
    before = stage_pixels(page)
    for layer in ("photograph", "smears", "inliers", "lines", "sigma", "mask", "probability"):
        toggle(page, layer)
        changed = (abs(stage_pixels(page) - before).max(axis=-1) > 20).sum()
        assert changed >= (2 if layer == "photograph" else 200), layer
        toggle(page, layer)
        np.testing.assert_array_equal(stage_pixels(page), before, err_msg=layer)


def test_maps_have_their_colours_at_their_places(opened: Opener) -> None:
    page = opened(Entry.of(made_up(F=turning_F()), boxed_mask()))
    toggle(page, "photograph", "smears")
    backdrop, scale = stage_pixels(page)[5, 5], scale_of(page)
    left, top, right, bottom = MOVING_BOX
    row, column = round((top + bottom) / 2 * scale), round((left + right) / 2 * scale)
    toggle(page, "mask")
    assert page.locator("#mask-reason").inner_text() == f"{headline(boxed_mask())}; F"  # as it is printed
    pixels = stage_pixels(page)
    pink = near(pixels, tuple((np.array([255, 64, 160]) * 150 + backdrop * 105) / 255), 12)
    for line, low, high in ((pink[row], left, right), (pink[:, column], top, bottom)):
        hits = np.flatnonzero(line[: round(450 * scale)])
        assert abs(hits[0] - low * scale) <= 1 and abs(hits[-1] + 1 - high * scale) <= 1
    toggle(page, "mask", "probability")
    profile = stage_pixels(page)[row].sum(axis=-1)
    low_level, high_level = profile[round(60 * scale)], profile[column]
    crossing = np.flatnonzero(profile > (low_level + high_level) / 2)[0]
    assert abs(crossing - 99.5 * scale) <= 1  # halfway between the nodes at 97 and 101
    toggle(page, "probability", "sigma")
    pixels = stage_pixels(page)
    for x, colour in ((4, (0x44, 0x01, 0x54)), (WIDTH - 5, (0xFD, 0xE7, 0x25))):
        expected = (np.array(colour) * 200 + backdrop * 55) / 255
        assert abs(pixels[row, round(x * scale)] - expected).max() < 12


def test_used_smears_have_the_colour_of_their_orientation(opened: Opener) -> None:
    one = made_up(F=turning_F())
    page = opened(Entry.of(one))
    toggle(page, "photograph", "smears", "inliers")
    pixels, scale = stage_pixels(page), scale_of(page)
    inliers = np.flatnonzero(one.estimate.geometry.inlier_mask)
    assert 0 < len(inliers) < len(one.estimate.matches)
    agree = []
    for k in [*inliers[:20], *np.flatnonzero(~one.estimate.geometry.inlier_mask)[:20]]:
        x, y = one.estimate.matches.midpoint[k]
        dx, dy = one.estimate.matches.displacement[k]
        hue = math.degrees(math.atan2(dy, dx)) % 180 / 180
        colour = 255 * np.array(colorsys.hls_to_rgb(hue, 0.63, 1)) if k in inliers else np.full(3, 190)
        seen = pixels[int((y + 0.5) * scale), int((x + 0.5) * scale)]
        agree.append(abs(seen - colour).max() < 30)
    assert np.mean(agree) > 0.7  # some are hidden by neighbours


def test_click_takes_the_used_smear_of_its_cell_where_those_are_shown(opened: Opener) -> None:
    one = made_up(F=turning_F())
    page = opened(Entry.of(one))
    toggle(page, "inliers")
    middle = one.estimate.matches.midpoint
    x, y = middle[np.linalg.norm(middle - (WIDTH / 2, HEIGHT / 2), axis=1).argmin()].tolist()
    click_at(page, (x + 13, y - 14))
    assert numbers(value(page, "position")) == [x, y] and value(page, "used") in ("inlier", "outlier")
    toggle(page, "inliers")
    click_at(page, (x + 13, y - 14))
    assert numbers(value(page, "position")) == [x + 13.5, y - 14.5]  # the nearest node
    assert value(page, "used") in ("inlier", "outlier")


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
    outline = page.evaluate(
        "(({outlineStyle, outlineWidth}) => [outlineStyle, outlineWidth])(getComputedStyle(stage))"
    )
    assert outline == ["solid", "3px"]
    page.keyboard.press("ArrowRight")
    x, y = numbers(value(page, "position"))
    assert abs(x - WIDTH / 2) < 5 and abs(y - HEIGHT / 2) < 5
    page.keyboard.press("Shift+ArrowDown")
    page.keyboard.press("Shift+ArrowLeft")
    assert numbers(value(page, "position")) == [x - 4, y + 4]
    assert f"Smear at {x - 4:.0f}, {y + 4:.0f}: length" in page.locator("#spoken").inner_text()
    page.keyboard.press("ArrowUp")
    moved = numbers(value(page, "position"))
    assert moved[0] == x - 4 and 8 <= y + 4 - moved[1] <= 32
    page.keyboard.press("+")
    settle(page)
    assert "stage-zoomed" in (page.locator("#stage").get_attribute("class") or "")
    page.keyboard.press("0")
    settle(page)
    assert "stage-zoomed" not in (page.locator("#stage").get_attribute("class") or "")
    for _ in range(80):
        page.keyboard.press("Shift+ArrowLeft")
    assert numbers(value(page, "position"))[0] == 1  # and no farther
    page.keyboard.press("Escape")
    settle(page)
    assert value(page, "position") == "-" and page.locator("[data-mark]").count() == 0
    page.locator("[data-layer=sigma]").focus()
    page.keyboard.press("Space")
    settle(page)
    assert page.locator("[data-layer=sigma]").is_checked() and page.locator("[data-key=sigma]").is_visible()


def test_drag_pans_the_zoomed_photograph_and_chooses_nothing(opened: Opener) -> None:
    page = opened(Entry.of(made_up(F=turning_F())))
    toggle(page, "smears")
    page.locator("[data-zoom=in]").click(click_count=4)
    settle(page)
    before = stage_pixels(page)
    box = page.locator("#stage").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 400, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 350, box["y"] + 180, steps=5)
    page.mouse.up()
    settle(page)
    after = stage_pixels(page)
    np.testing.assert_array_equal(after[40:-60, 40:-90], before[60:-40, 90:-40])
    assert value(page, "position") == "-"
