"""What the tests of the report in headless Chromium share: opening it, using it, reading it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Browser, Page

from blur2view.pipeline import FileEstimate
from blur2view.results.report import Entry, report
from blur2view.smears.field import smear_ends
from tests.support.report_scenes import WIDTH
from tools.reports.report_screenshot import settle, wait_until_drawn

CYAN, AMBER = (34, 211, 238), (251, 191, 36)  # of the ends 1 and 2 and of the lines in their views

Opener = Callable[..., Page]


@dataclass(kw_only=True)
class Visits:
    """Reports that were opened; what their pages say and ask for is noted."""

    browser: Browser
    folder: Path
    pages: list[Page] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def open(
        self, *entries: Entry, address: str = "", size: tuple[int, int] = (1280, 800), **how: Any
    ) -> Page:
        """Open a report of these photographs and wait until it is drawn."""
        file = self.folder / f"report{len(self.pages)}.html"
        file.write_bytes(report(entries, "1.0"))
        context = self.browser.new_context(viewport={"width": size[0], "height": size[1]}, **how)
        context.set_default_timeout(15_000)
        page = context.new_page()
        self.pages.append(page)
        page.on("console", lambda message: self.messages.append(message.text))
        page.on("pageerror", lambda error: self.messages.append(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))
        page.goto(file.as_uri() + address)
        wait_until_drawn(page)
        return page

    def close(self) -> None:
        """Close the pages, none of which may have complained or asked for anything but itself."""
        for page in self.pages:
            page.context.close()
        assert self.messages == []
        assert all(url.startswith(("file:", "data:", "blob:")) for url in self.requests)
        assert sum(url.startswith("file:") for url in self.requests) == len(self.pages)


def toggle(page: Page, *layers: str) -> None:
    """Click on the layers' checkboxes."""
    for layer in layers:
        page.locator(f"[data-layer={layer}]").click()
    settle(page)


def scale_of(page: Page) -> float:
    """Screen pixels per pixel of the photograph, the whole photograph being shown."""
    box = page.locator("#stage").bounding_box()
    assert box is not None
    return box["width"] / WIDTH


def click_at(page: Page, point: tuple[float, float]) -> None:
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


def quantised_ends(one: FileEstimate, x: int, y: int) -> NDArray[np.float64]:
    """Return the ends of the smear at a pixel, its displacement rounded to 1/64 pixel as the page has it."""
    displacement = one.estimate.grid.at_pixels().displacement[y, x].astype(float)
    ends = smear_ends(np.array([[x, y]], float), np.round(64 * displacement[None]) / 64)
    return np.asarray(ends[0], float)
