"""The report in headless Chromium: gallery, values, downloads, phone."""

import json
from pathlib import Path

from playwright.sync_api import Page

from blur2view.geometry.two_view_geometry import Configuration
from blur2view.results.report import Entry
from tests.support.report_browser import Opener, toggle, value
from tests.support.report_scenes import boxed_mask, made_up, turning_F
from tools.reports.report_screenshot import settle


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


def test_downloads_are_the_documents_of_estimate(opened: Opener, tmp_path: Path) -> None:
    entries = gallery_entries()
    page = opened(*entries, address="#photo-3")

    def downloaded(button: str) -> bytes:
        with page.expect_download() as download:
            page.locator(button).click()
        return Path(download.value.path()).read_bytes()

    texts = [json.loads(entry.content)["document"] for entry in entries if entry.content]
    assert downloaded("#download") == texts[2].encode() + b"\n"
    failures = [{"image": "a.png", "error": "a.png: is damaged"}]
    everything = {"estimates": list(map(json.loads, texts)), "failures": failures}
    assert downloaded("#download-all").decode() == json.dumps(everything, indent=2) + "\n"


def test_phone_shows_everything_without_sideways_scroll(opened: Opener) -> None:
    long = "folder/" + "a_very_long_name_without_any_blank" * 6 + ".png"
    entries = [
        Entry.of(made_up(long, F=turning_F()), boxed_mask()),
        Entry.failed(long, f"{long}: is damaged"),
        Entry.of(made_up("short", config=Configuration.PLANAR_OR_PANORAMIC)),
    ]
    how = {"has_touch": True, "is_mobile": True}
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
