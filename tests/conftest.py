"""Fixtures: tiny networks, pictures that they read, a browser."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import onnx
import pytest

from blur2view.cli import commands as cli
from tests.support.colour_code import colour_code, colour_code_network, forward_motion, write_picture

if TYPE_CHECKING:
    from playwright.sync_api import Browser

    from tests.support.report_browser import Opener

@pytest.fixture(scope="session")
def tiny_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Path of the tiny network without blur."""
    path = tmp_path_factory.mktemp("model") / "tiny.onnx"
    onnx.save(colour_code_network(), path)
    return path


@pytest.fixture(scope="session")
def blurring_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Path of the tiny network that looks at neighbouring cells."""
    path = tmp_path_factory.mktemp("model") / "blurring.onnx"
    onnx.save(colour_code_network(blur=True), path)
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    """Headless Chromium; where there is none the test is skipped."""
    from playwright.sync_api import sync_playwright

    from tools.reports.report_screenshot import find_chromium

    chromium = find_chromium()
    if chromium is None:
        pytest.skip("no Chromium here; apt-get install chromium")
    with sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=chromium)
        yield running
        running.close()


@pytest.fixture
def opened(browser: "Browser", tmp_path: Path) -> Iterator["Opener"]:
    """Return a function that opens a report; at the end no page may have complained or loaded anything."""
    from tests.support.report_browser import Visits

    visits = Visits(browser=browser, folder=tmp_path)
    yield visits.open
    visits.close()


@pytest.fixture
def moving(tmp_path: Path) -> Path:
    """Return a picture in which the tiny network sees forward motion."""
    return write_picture(tmp_path / "moving.png", colour_code(forward_motion(), 1.0))


@pytest.fixture
def still(tmp_path: Path) -> Path:
    """Return a picture in which the tiny network sees no motion."""
    return write_picture(tmp_path / "still.png", colour_code(np.zeros((64, 80, 2)), 1.0))


@pytest.fixture
def run(tiny_model: Path) -> Any:
    """Return ``blur2view estimate`` with the tiny network, in this process."""

    def call(*arguments: object) -> int:
        return cli.main(["estimate", "--model", str(tiny_model), *map(str, arguments)])

    return call
