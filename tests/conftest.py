"""Fixtures: tiny networks, pictures that they read. Markers that follow from what a test needs.

Without torch (``pip install '.[test]'``) the tests that need it are not collected, which the header says.
"""

import gc
import os
import signal
from collections.abc import Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path

if "PYTEST_XDIST_WORKER" in os.environ:  # one thread each; before numpy and torch read it
    os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import onnx
import pytest

from tests.support.calls import Call, Exit, call_program
from tests.support.colour_code import colour_code, colour_code_network, forward_motion, write_picture

NEEDS_TORCH = (
    "tools/training/test_*.py",
    "tools/paper/test_losses.py",
    "tools/rendering/test_layer_scenes.py",
)
collect_ignore_glob = [] if find_spec("torch") else list(NEEDS_TORCH)


def pytest_report_header() -> list[str]:
    """Return a line that says which tests are left out, if any."""
    return [f"no torch: without {', '.join(collect_ignore_glob)}"] if collect_ignore_glob else []


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect without collecting garbage: what modules hold stays, and no later round goes through it."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what needs torch; start with the checks of the repository, which take longest."""
    for item in items:
        path = item.path.relative_to(Path(__file__).parent)
        if any(path.match(pattern) for pattern in NEEDS_TORCH):
            item.add_marker("train")
    items.sort(key=lambda item: item.get_closest_marker("lint") is None)


def process_state() -> dict[str, object]:
    """Return what a test may change in its process, and the next one would meet."""
    return {
        "current folder": os.getcwd(),
        "answer to Ctrl-C": signal.getsignal(signal.SIGINT),
        "errors of NumPy": np.geterr(),
    }


@pytest.fixture(autouse=True)
def unchanged_process(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Give a test's environment back, and fail if it changes its process, so that no order decides."""
    before, environment = process_state(), dict(os.environ)
    yield
    monkeypatch.undo()
    if os.environ != environment:  # processes that were started in it have left their mark
        os.environ.clear()
        os.environ.update(environment)
    assert process_state() == before


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


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, a temporary one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def moving(tmp_path: Path) -> Path:
    """Return a picture in which the tiny network sees forward motion."""
    return write_picture(tmp_path / "moving.png", colour_code(forward_motion(), 1.0))


@pytest.fixture
def still(tmp_path: Path) -> Path:
    """Return a picture in which the tiny network sees no motion."""
    return write_picture(tmp_path / "still.png", colour_code(np.zeros((64, 80, 2)), 1.0))


@pytest.fixture
def call(tiny_model: Path, capsys: pytest.CaptureFixture[str]) -> Call:
    """Return a function that runs a command over photographs with the tiny network, in this process."""

    def run(command: str, *words: object) -> Exit:
        return call_program(capsys, command, "--model", tiny_model, "--jobs", 1, *words)

    return run


@pytest.fixture
def run(call: Call) -> Call:
    """Return ``blur2view estimate`` with the tiny network, in this process."""
    return partial(call, "estimate")
