"""Take a picture of a report in headless Chromium and say how large it is.

``python -m tools.reports.report_screenshot models/sample.jpg --out tools/results/report.webp``
"""

from __future__ import annotations

import shutil
import tempfile
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from blur2view.cli import commands as cli
from tools.arguments import Existing, Target, run
from tools.pages import write_picture

BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def find_chromium() -> str | None:
    """Return the path of an installed Chromium, None without."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


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
        print(f"{report.stat().st_size / 1e6:.2f} MB")
        lines = page.locator("input[name=lines]")
        if lines.is_enabled():
            lines.check()
        with Image.open(BytesIO(page.screenshot())) as shown:
            write_picture(out, np.asarray(shown.convert("RGB")))


if __name__ == "__main__":
    run(main)
