"""Take a picture of a report, and measure its size and the time it takes to open.

``python -m tools.reports.report_screenshot models/sample.jpg --out tools/results/report.webp`` makes the
report, opens it in headless Chromium several times, prints its size and the median time from the start of
navigation until everything is drawn, chooses a smear and takes the picture.
"""

from __future__ import annotations

import shutil
import tempfile
from io import BytesIO
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from blur2view.cli import commands as cli
from tools.arguments import Existing, Target, run
from tools.pages import write_picture

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WINDOW = (1280, 800)
OPENINGS = 5
READY = "performance.getEntriesByName('blur2view-ready')"
AT = (0.3, 0.7)  # of the photograph's width and height
LAYERS = ("smears", "lines")
"""Drawn in the picture, besides the photograph."""


def find_chromium() -> str | None:
    """Return the path of an installed Chromium, None without."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


def open_report(browser: Browser, report: Path) -> tuple[Page, float]:
    """Open a report; return its page and the seconds until all was drawn."""
    page = browser.new_page(viewport={"width": WINDOW[0], "height": WINDOW[1]})
    page.goto(report.as_uri())
    while not page.evaluate(f"{READY}.length > 0"):  # Playwright's own waiting is against the page's policy
        page.wait_for_timeout(20)
    return page, page.evaluate(f"{READY}[0].startTime") / 1000


def choose(page: Page) -> None:
    """Draw LAYERS and choose the smear at AT."""
    for box in page.locator("[data-layer]").all():
        layer = box.get_attribute("data-layer")
        if box.is_visible():
            box.set_checked(layer in (*LAYERS, "photograph"))
    stage = page.locator("#stage")
    area = stage.bounding_box()
    if area is not None:
        stage.click(position={"x": AT[0] * area["width"], "y": AT[1] * area["height"]})
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    page.evaluate("window.scrollTo(0, 0)")


def main(photograph: Existing, *, out: Target | None = None) -> None:
    """Measure the report of a photograph; write its picture as WebP where a path is given."""
    from playwright.sync_api import sync_playwright

    chromium = find_chromium()
    if chromium is None:
        raise SystemExit("no Chromium here; apt-get install chromium")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        report = Path(folder) / "report.html"
        cli.main(["report", str(photograph), "-o", str(report)])
        browser = driver.chromium.launch(executable_path=chromium)
        opened = [open_report(browser, report) for _ in range(OPENINGS)]
        seconds = median(each for _, each in opened)
        print(f"{report.stat().st_size / 1e6:.2f} MB, opens in {seconds:.2f} s (median of {OPENINGS})")
        if out is not None:
            page = opened[-1][0]
            choose(page)
            with Image.open(BytesIO(page.screenshot())) as shown:
                write_picture(out, np.asarray(shown.convert("RGB")))
        browser.close()


if __name__ == "__main__":
    run(main)
