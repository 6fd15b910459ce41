"""The report in headless Chromium: what is drawn, told and done is what the estimate says."""

import colorsys
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright
from report_scenes import DOTS, HEIGHT, MOVING_BOX, WIDTH, boxed_mask, made_up, turning_F

from blur2view.cameras import Camera
from blur2view.epipolar import sampson, serrmin
from blur2view.geometry import Configuration
from blur2view.report import Entry, report
from blur2view.smear import smear_ends
from blur2view.viz import farthest_points
from tools.report_screenshot import find_chromium

CHROMIUM = find_chromium()
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here; apt-get install chromium")

READY = "performance.getEntriesByName('blur2view-ready').length > 0"
CYAN, AMBER = (
    (34, 211, 238),
    (251, 191, 36),
)  # of the first and the second end and of the lines in their views


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Headless Chromium."""
    with sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=CHROMIUM)
        yield running
        running.close()


@dataclass(kw_only=True)
class Watched:
    """A page whose messages and requests are noted."""

    page: Page
    messages: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def listen(self) -> None:
        """Note whatever the page says or asks for."""
        self.page.on("console", lambda message: self.messages.append(message.text))
        self.page.on("pageerror", lambda error: self.messages.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))


Opener = Callable[..., Page]


@pytest.fixture
def opened(browser: Browser, tmp_path: Path) -> Iterator[Opener]:
    """Return a function that opens a report; at the end no page may have complained or asked for anything."""
    watched: list[Watched] = []

    def open_report(
        *entries: Entry, address: str = "", size: tuple[int, int] = (1280, 800), **how: Any
    ) -> Page:
        file = tmp_path / f"report{len(watched)}.html"
        file.write_bytes(report(entries, "1.0"))
        context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **how)
        context.set_default_timeout(15_000)
        one = Watched(page=context.new_page())
        watched.append(one)
        one.listen()
        one.page.goto(file.as_uri() + address)
        one.page.wait_for_function(READY)
        return one.page

    yield open_report
    for one in watched:
        assert one.messages == []
        assert all(url.startswith(("file:", "data:", "blob:")) for url in one.requests)
        assert sum(url.startswith("file:") for url in one.requests) == 1
        one.page.context.close()


def settle(page: Page) -> None:
    """Wait until what was asked for is drawn."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def toggle(page: Page, *layers: str) -> None:
    """Click on the layers' checkboxes."""
    for layer in layers:
        page.locator(f"[data-layer={layer}]").click()
    settle(page)


def stage_pixels(page: Page) -> NDArray[np.float64]:
    """Return the stage as it is seen, without its buttons, (h, w, 3) of 0 to 255."""
    page.evaluate("document.querySelector('.zoom').style.visibility = 'hidden'")
    shot = page.locator("#stage").screenshot(animations="disabled")
    return np.asarray(Image.open(BytesIO(shot)).convert("RGB"), float)


def scale_of(page: Page) -> float:
    """Screen pixels per pixel of the photograph, the whole photograph being shown."""
    box = page.locator("#stage").bounding_box()
    assert box is not None
    return box["width"] / WIDTH


def click_at(page: Page, point: tuple[float, float], zoom: float = 1.0) -> None:
    """Click on a pixel of a photograph that is shown whole."""
    scale = scale_of(page)
    page.locator("#stage").click(position={"x": (point[0] + 0.5) * scale, "y": (point[1] + 0.5) * scale})
    settle(page)


def near(
    pixels: NDArray[np.float64], colour: tuple[int, int, int], tolerance: float = 70
) -> NDArray[np.bool_]:
    """Pixels of a colour."""
    close: NDArray[np.bool_] = abs(pixels - colour).max(axis=-1) < tolerance
    return close


def value(page: Page, key: str, of: str = "chosen") -> str:
    """Return a value of the table."""
    return page.locator(f"[data-value={key}][data-of={of}]").inner_text()


def numbers(text: str) -> list[float]:
    """Return the numbers in a text."""
    kept = "".join(letter if letter.isdigit() or letter in ".-" else " " for letter in text)
    return [float(word) for word in kept.split() if word != "-"]


def quantised_ends(point: tuple[int, int], displacement: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the ends of the smear at a pixel, its displacement rounded to 1/64 pixel as the page has it."""
    rounded = np.round(64.0 * displacement.astype(float)) / 64
    ends: NDArray[np.float64] = smear_ends(np.array([point], float), rounded[None])[0]
    return ends


def in_order(F: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Both ends, the one of view 1 first, by the smaller Sampson distance."""
    forward, backward = (sampson(F, *(end[None] for end in pair))[0] for pair in (ends, ends[::-1]))
    return ends if forward <= backward else ends[::-1]


def line_offsets(
    pixels: NDArray[np.float64],
    colour: tuple[int, int, int],
    line: NDArray[np.float64],
    hidden: Callable[[float, float], bool],
) -> NDArray[np.float64]:
    """Return distances from a line of the screen to the middle of its colour, in columns where it is seen."""
    offsets = []
    tilt = math.hypot(*line[:2]) / abs(line[1])
    for column in range(4, pixels.shape[1] - 4):
        y = -(line[0] * (column + 0.5) + line[2]) / line[1]
        top = round(y) - 9
        if top < 0 or top + 18 > len(pixels) or hidden(column, y):
            continue
        rows = np.flatnonzero(near(pixels[top : top + 18, column], colour))
        offsets.append((top + rows.mean() + 0.5 - y) / tilt if len(rows) else np.inf)
    return np.array(offsets)


def on_screen(line: NDArray[np.float64], scale: float, corner: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a line of the photograph on the screen, where pixel (0, 0) lies at ``corner``."""
    a, b, c = line
    return np.array([a, b, c * scale - a * corner[0] - b * corner[1]])


def check_lines(
    pixels: NDArray[np.float64],
    F: NDArray[np.float64],
    ends: NDArray[np.float64],
    scale: float,
    corner: NDArray[np.float64],
    off_px: float = 0.0,
) -> None:
    """Check that both lines of a smear are drawn to a pixel, and nothing else has their colours.

    ``corner`` is where pixel (0, 0) lies on the screen, give or take ``off_px``.
    """
    first, second = in_order(F, ends)
    lines = [on_screen(line, scale, corner) for line in (F.T @ [*second, 1], F @ [*first, 1])]
    lines = [line / math.hypot(*line[:2]) for line in lines]
    middle = scale * ends.mean(axis=0) + corner
    # the ends and their numbers have these colours too
    reach = 40 + scale * np.linalg.norm(ends[1] - ends[0]) / 2

    def hidden(x: float, y: float, by: NDArray[np.float64]) -> bool:
        return bool(math.hypot(x - middle[0], y - middle[1]) < reach or abs(by @ [x, y, 1]) < 14)

    for colour, line, other in zip((CYAN, AMBER), lines, lines[::-1], strict=True):
        offsets = line_offsets(pixels, colour, line, lambda x, y, by=other: hidden(x, y, by))  # type: ignore[misc]
        assert len(offsets) > 100
        assert abs(offsets).max() < 1 + off_px and abs(offsets.mean()) < 0.3 + off_px
        rows, columns = np.nonzero(near(pixels, colour, 40))
        away = abs(line @ [columns + 0.5, rows + 0.5, np.ones(len(rows))])
        assert ((away < 4) | (np.hypot(columns - middle[0], rows - middle[1]) < reach)).all()


@pytest.mark.parametrize("point", [(201, 121), (449, 273), (81, 321)])
def test_click_draws_both_epipolar_lines_where_F_says(opened: Opener, point: tuple[int, int]) -> None:
    F, one = turning_F(), made_up(F=turning_F())
    page = opened(Entry.of(one))
    toggle(page, "photograph", "smears")
    click_at(page, (point[0] + 1.2, point[1] - 1.4))  # nearest to this node
    assert numbers(value(page, "position")) == list(point)
    ends = quantised_ends(point, one.found.field.displacement[point[1], point[0]])
    scale = scale_of(page)
    check_lines(stage_pixels(page), F, ends, scale, np.full(2, scale / 2))


def test_lines_and_ends_stay_with_the_photograph_when_zoomed(opened: Opener) -> None:
    F, one = turning_F(), made_up(F=turning_F())
    page = opened(Entry.of(one))
    toggle(page, "smears")
    click_at(page, DOTS[0])
    for _ in range(5):
        page.keyboard.press("+")
    settle(page)
    marked = stage_pixels(page)
    page.evaluate("document.getElementById('marks').style.visibility = 'hidden'")
    bare = stage_pixels(page).min(axis=-1)
    bare[:9] = bare[-9:] = 0  # the page shows through its round corners
    split = np.indices(bare.shape)[1] > centre_of(bare)[0]
    found = np.array([centre_of(np.where(split == side, bare, 0)) for side in (0, 1)])
    scale = float(np.linalg.norm(found[1] - found[0]) / np.linalg.norm(np.subtract(*DOTS)))
    corner = found[0] - scale * np.array(DOTS[0])
    assert scale > 8  # half a pixel is at least 4 pixels of the screen
    ends = quantised_ends(DOTS[0], one.found.field.displacement[DOTS[0][1], DOTS[0][0]])
    check_lines(marked, F, ends, scale, corner, 0.5)  # the dots' borders are those of the screen's pixels
    for mark, end in zip(("end-1", "end-2"), in_order(F, ends), strict=True):
        circle = page.locator(f"[data-mark={mark}]")
        drawn = [float(circle.get_attribute(key) or "nan") for key in ("cx", "cy")]
        assert np.linalg.norm(scale * end + corner - drawn) < 1.5


def centre_of(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centre (x, y) of what is brighter than half of white, in pixels of the screen."""
    y, x = np.nonzero(weights > 127)
    return np.array([x.mean() + 0.5, y.mean() + 0.5])


def test_hover_tells_the_values_of_the_estimate(opened: Opener) -> None:
    F, one = turning_F(), made_up(F=turning_F())
    page, field_ = opened(Entry.of(one, boxed_mask())), one.found.field
    used = one.found.matches.midpoint.round().astype(int).tolist()
    inner = [point for point in used if 20 < point[0] < WIDTH - 20 and 20 < point[1] < HEIGHT - 20]
    assert field_.sigma_rad is not None
    inside, right = (153, 101), (609, 201)
    for x, y in [inside, right, *inner[:3]]:
        scale = scale_of(page)
        page.locator("#stage").hover(position={"x": (x + 1.4) * scale, "y": (y - 0.4) * scale})
        d, ends = field_.displacement[y, x], quantised_ends((x, y), field_.displacement[y, x])

        def told(key: str) -> list[float]:
            return numbers(value(page, key, "pointer"))

        assert told("position") == [x, y]
        assert told("displacement") == pytest.approx(d.tolist(), abs=0.02)
        assert told("length") == pytest.approx([np.hypot(*d)], abs=0.02)
        assert told("direction") == pytest.approx([np.degrees(np.arctan2(d[1], d[0]))], abs=0.1)
        assert told("sigma") == pytest.approx([field_.sigma_px[y, x]], abs=0.02)
        assert told("sigma-direction") == pytest.approx([np.degrees(field_.sigma_rad[y, x])], abs=0.1)
        assert told("error") == pytest.approx(np.sqrt(serrmin(F, ends[None])), abs=0.006)
        label = "moving" if (x, y) == inside else ("unobservable" if x >= 480 else "static")
        assert value(page, "label", "pointer") == label
        assert told("probability") == [0.9 if (x, y) == inside else 0.1]
        mask = dict(zip(map(tuple, used), one.found.geometry.inlier_mask.tolist(), strict=True))
        words = {True: "inlier", False: "outlier", None: "not used"}
        assert value(page, "used", "pointer") == words[mask.get((x, y))]
    page.mouse.move(2, 2)
    assert value(page, "length", "pointer") == "-"


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


def test_fan_of_epipolar_lines_is_where_F_says(opened: Opener) -> None:
    F, one = turning_F(), made_up(F=turning_F())
    page = opened(Entry.of(one))
    toggle(page, "photograph", "smears", "lines")
    pixels, scale = stage_pixels(page), scale_of(page)
    inliers = np.flatnonzero(one.found.geometry.inlier_mask)
    chosen = inliers[farthest_points(one.found.matches.midpoint[inliers], 14)]
    white = near(pixels, (255, 255, 255), 165)
    explained = np.zeros_like(white)
    for k in chosen:
        line = on_screen(F @ [*in_order(F, one.found.matches.ends[k])[0], 1], scale, np.full(2, scale / 2))
        columns = np.arange(len(pixels[0])) + 0.5
        rows = -(line[0] * columns + line[2]) / line[1]
        seen = [(int(y), int(x)) for y, x in zip(rows, columns, strict=True) if 3 <= y < len(pixels) - 3]
        assert np.mean([white[y - 1 : y + 2, x].any() for y, x in seen]) > 0.98
        for y, x in seen:
            explained[y - 3 : y + 4, x] = True
    inner = np.s_[9:-9, 9:-9]  # the page shows through the stage's round corners
    assert (white & ~explained)[inner].sum() < 0.1 * white.sum()  # rings of the epipoles, steep ends


def test_used_smears_have_the_colour_of_their_orientation(opened: Opener) -> None:
    one = made_up(F=turning_F())
    page = opened(Entry.of(one))
    toggle(page, "photograph", "smears", "inliers")
    pixels, scale = stage_pixels(page), scale_of(page)
    inliers = np.flatnonzero(one.found.geometry.inlier_mask)
    assert 0 < len(inliers) < len(one.found.matches)
    agree = []
    for k in [*inliers[:20], *np.flatnonzero(~one.found.geometry.inlier_mask)[:20]]:
        x, y = one.found.matches.midpoint[k]
        dx, dy = one.found.matches.displacement[k]
        hue = math.degrees(math.atan2(dy, dx)) % 180 / 180
        colour = 255 * np.array(colorsys.hls_to_rgb(hue, 0.63, 1)) if k in inliers else np.full(3, 190)
        seen = pixels[int((y + 0.5) * scale), int((x + 0.5) * scale)]
        agree.append(abs(seen - colour).max() < 30)
    assert np.mean(agree) > 0.7  # some are hidden by neighbours


def test_click_takes_a_used_smear_where_those_are_shown(opened: Opener) -> None:
    one = made_up(F=turning_F())
    page = opened(Entry.of(one))
    toggle(page, "inliers")
    middle = one.found.matches.midpoint
    x, y = middle[np.linalg.norm(middle - (WIDTH / 2, HEIGHT / 2), axis=1).argmin()].tolist()
    click_at(page, (x + 3.5, y - 2.5))
    assert numbers(value(page, "position")) == [x, y] and value(page, "used") in ("inlier", "outlier")


def test_without_F_there_are_ends_and_no_lines(opened: Opener) -> None:
    page = opened(Entry.of(made_up(config=Configuration.DEGENERATE)))
    click_at(page, (201, 121))
    marks = page.locator("[data-mark]").evaluate_all("(all) => all.map((mark) => mark.dataset.mark)")
    assert sorted(marks) == ["end-1", "end-2", "smear", "smear-halo"]
    assert value(page, "error") == "-" and value(page, "label") == "-"
    shown = page.locator("label:visible [data-layer]").evaluate_all(
        "(all) => all.map((box) => box.dataset.layer)"
    )
    assert shown == ["photograph", "smears", "inliers", "sigma"]
    assert page.locator("#geometry, #models").evaluate_all("(all) => all.every((one) => one.hidden)")


def test_lines_of_a_distorting_lens_are_curves(opened: Opener) -> None:
    camera = Camera.from_string(f"SIMPLE_RADIAL {WIDTH} {HEIGHT} 500 320 180 0.6")
    F, one = turning_F(), made_up(F=turning_F(), camera=camera)
    page = opened(Entry.of(one))
    point = (121, 41)
    click_at(page, point)
    ends = camera.undistorted(quantised_ends(point, one.found.field.displacement[point[1], point[0]]))
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
    assert f"Smear at {x - 4:.0f}, {y + 4:.0f}: length" in page.locator("#said").inner_text()
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


def gallery_entries() -> list[Entry]:
    """Four photographs and a failure."""
    F = turning_F()
    return [
        Entry.of(made_up("b10.png", F=F)),
        Entry.of(made_up("b9.png", config=Configuration.DEGENERATE, scale=0.2)),
        Entry.failed("a.png", "a.png: is damaged"),
        Entry.of(made_up("c.png", F=F, config=Configuration.CALIBRATED, scale=2)),
        Entry.of(made_up("d.png", F=F, config=Configuration.MULTIPLE, scale=0.5)),
    ]


def names(page: Page) -> list[str]:
    """Return the names on the cards, first letters and numbers alone."""
    return [name.removesuffix(".png") for name in page.locator(".card-name").all_inner_texts()]


def test_gallery_sorts_by_verdict_length_and_name(opened: Opener) -> None:
    page = opened(*gallery_entries())
    by, reverse = page.locator("#sort-by"), page.locator("#sort-direction")
    assert names(page) == ["b10", "b9", "a", "c", "d"]
    by.select_option("verdict")
    assert names(page) == ["c", "b10", "d", "b9", "a"]
    by.select_option("length")
    assert names(page) == ["b9", "d", "b10", "c", "a"]
    reverse.click()
    assert names(page) == ["c", "b10", "d", "b9", "a"]  # what has no length stays last
    by.select_option("name")
    assert names(page) == ["d", "c", "b10", "b9", "a"]
    reverse.click()
    assert names(page) == ["a", "b9", "b10", "c", "d"]


def test_gallery_is_walked_with_the_keyboard(opened: Opener) -> None:
    page = opened(*gallery_entries())
    page.locator("#sort-by").focus()
    page.keyboard.type("median")
    assert names(page)[0] == "b9"
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    title = page.locator("#photo-name")
    title.get_by_text("b9.png").wait_for()
    assert page.evaluate("document.activeElement.id") == "photo-title"
    assert page.locator("#to-previous").is_hidden() and page.locator("#gallery").is_hidden()
    for name in ("d.png", "b10.png", "c.png"):
        page.locator("#to-next").focus()
        page.keyboard.press("Enter")
        title.get_by_text(name).wait_for()
    assert page.locator("#to-next").is_hidden()
    page.locator("#to-gallery").focus()
    page.keyboard.press("Enter")
    page.locator("#gallery").wait_for()
    assert page.evaluate("document.activeElement.getAttribute('href')") == "#photo-3"
    page.go_back()
    title.get_by_text("c.png").wait_for()


def test_address_names_a_photograph(opened: Opener) -> None:
    page = opened(*gallery_entries(), address="#photo-3")
    assert (
        page.locator("#photo-name").inner_text() == "c.png"
        and page.locator("#chip").inner_text() == "CALIBRATED"
    )
    page = opened(*gallery_entries(), address="#photo-2")  # which failed
    assert page.locator("#gallery").is_visible() and page.locator("#photo").is_hidden()


def test_facts_are_those_of_the_document(opened: Opener) -> None:
    one = made_up(F=turning_F())
    page = opened(Entry.of(one, None, 0.25))
    assert page.locator("#reason").inner_text() == "the figures <that> decided & more"
    scores = page.locator("#scores li").all_inner_texts()
    assert [score.split("\n") for score in scores] == [
        ["camera", "+0.0"],
        ["plane", "+17.6"],
        ["general", "+59.1"],
    ]
    assert "bar-chosen" in (page.locator("#scores li").first.get_attribute("class") or "")
    F = np.array([float(cell) for cell in page.locator("#matrix td").all_inner_texts()]).reshape(3, 3)
    np.testing.assert_allclose(F, one.facts["F"], rtol=1e-4)
    assert page.locator("#seconds li").last.inner_text().split("\n") == ["total", "0.80 s"]


def test_downloads_are_the_documents_of_estimate(opened: Opener, tmp_path: Path) -> None:
    entries = gallery_entries()
    page = opened(*entries, address="#photo-3")

    def downloaded(button: str) -> bytes:
        with page.expect_download() as download:
            page.locator(button).click()
        return Path(download.value.path()).read_bytes()

    told = [json.loads(entry.content)["document"] for entry in entries if entry.content]
    assert downloaded("#download") == told[2].encode() + b"\n"
    everything = {
        "estimates": list(map(json.loads, told)),
        "failures": [{"image": "a.png", "error": "a.png: is damaged"}],
    }
    assert downloaded("#download-all").decode() == json.dumps(everything, indent=2) + "\n"
    click_at(page, (201, 121))
    picture = np.asarray(Image.open(BytesIO(downloaded("#save-picture"))).convert("RGB"), float)
    assert near(picture, AMBER).sum() > 200 and near(picture, CYAN).sum() > 200


def pinch(page: Page) -> None:
    """Spread two fingers on the stage."""
    box = page.locator("#stage").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    session = page.context.new_cdp_session(page)
    for kind, reach in (("touchStart", 20), ("touchMove", 40), ("touchMove", 70), ("touchEnd", 0)):
        points = [{"x": x + side * reach, "y": y, "id": side} for side in (-1, 1)] if reach else []
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    settle(page)


@pytest.mark.parametrize("dark", [False, True])
def test_phone_shows_everything_without_sideways_scroll(opened: Opener, dark: bool) -> None:
    long = "folder/" + "a_very_long_name_without_any_blank" * 6 + ".png"
    entries = [
        Entry.of(made_up(long, F=turning_F()), boxed_mask()),
        Entry.failed(long, f"{long}: is damaged"),
        Entry.of(made_up("short", config=Configuration.PLANAR_OR_PANORAMIC)),
    ]
    how = {"has_touch": True, "is_mobile": True, "color_scheme": "dark" if dark else "light"}
    page = opened(*entries, size=(390, 844), **how)
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    fits = "(cards) => cards.every((card) => card.scrollWidth <= card.clientWidth)"
    assert page.locator(".card").evaluate_all(fits)
    page.locator("a.card-body").first.tap()
    page.locator("#photo").wait_for()
    settle(page)
    toggle(page, "lines", "sigma", "mask", "probability", "inliers")
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    page.locator("#stage").tap(position={"x": 120, "y": 90})
    settle(page)
    assert value(page, "length").endswith(" px") and page.locator("[data-mark=line-2]").count() == 1
    pinch(page)
    assert "stage-zoomed" in (page.locator("#stage").get_attribute("class") or "")
    red, green, blue = numbers(page.evaluate("getComputedStyle(document.body).backgroundColor"))
    assert (red + green + blue < 128) == dark


def test_old_browser_is_told(browser: Browser, tmp_path: Path) -> None:
    (tmp_path / "old.html").write_bytes(report(gallery_entries(), "1.0"))
    page = browser.new_page()
    page.add_init_script("delete window.DecompressionStream")
    page.goto((tmp_path / "old.html").as_uri())
    assert "too old" in page.locator("#notice").inner_text() and page.locator(".card").count() == 5
    page.close()
