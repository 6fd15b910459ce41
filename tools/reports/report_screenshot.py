"""Take a picture of a report in headless Chromium, with a smear chosen, and say how large it is and how fast.

``python -m tools.reports.report_screenshot models/sample.jpg --out tools/results/report.webp``
"""

from __future__ import annotations

import shutil
import tempfile
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from blur2view.cli import commands as cli
from tools.arguments import Existing, Target, run
from tools.pages import write_picture

if TYPE_CHECKING:
    from playwright.sync_api import Page

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
READY = "performance.getEntriesByName('blur2view-ready')"
AT = (0.3, 0.7)  # of the photograph's width and height
LAYERS = ("photograph", "smears", "lines")
"""Drawn in the picture."""


def find_chromium() -> str | None:
    """Return the path of an installed Chromium, None without."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


def wait_until_drawn(page: Page, polls: int = 750) -> None:
    """Ask every 20 ms from outside: Playwright's own waiting is against the page's policy."""
    for _ in range(polls):
        if page.evaluate(f"{READY}.length > 0"):
            return
        page.wait_for_timeout(20)
    raise AssertionError("the report was not drawn in time")


def settle(page: Page) -> None:
    """Wait until what was asked for is drawn."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def main(photograph: Existing, *, out: Target) -> None:
    """Write the picture of a photograph's report as WebP."""
    from playwright.sync_api import sync_playwright

    if (chromium := find_chromium()) is None:
        raise SystemExit("no Chromium here; apt-get install chromium")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        report = Path(folder) / "report.html"
        cli.main(["report", str(photograph), "-o", str(report)])
        page = driver.chromium.launch(executable_path=chromium).new_page(
            viewport={"width": 1280, "height": 800}
        )
        page.goto(report.as_uri())
        wait_until_drawn(page)
        seconds = page.evaluate(f"{READY}[0].startTime") / 1000
        print(f"{report.stat().st_size / 1e6:.2f} MB, opens in {seconds:.2f} s")
        for box in filter(lambda box: box.is_visible(), page.locator("[data-layer]").all()):
            box.set_checked(box.get_attribute("data-layer") in LAYERS)
        area = page.locator("#stage").bounding_box()
        assert area is not None
        page.locator("#stage").click(position={"x": AT[0] * area["width"], "y": AT[1] * area["height"]})
        settle(page)
        page.evaluate("window.scrollTo(0, 0)")
        with Image.open(BytesIO(page.screenshot())) as shown:
            write_picture(out, np.asarray(shown.convert("RGB")))


if __name__ == "__main__":
    run(main)
