"""Tools that are given what is not there say so in one line; their workers have one thread."""

import contextlib
import os
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

from tests.test_layers import third_party
from tools import EXTRA_OF
from tools.processes import THREAD_COUNTS, single_threaded_pool

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    "words",
    [
        "datasets.sample nowhere.txt/sample.jpg",
        "datasets.sample sample.jpg --photos nowhere",
        "evaluation.even_blur nowhere",
    ],
)
def test_what_is_not_there_is_wrong_usage(
    words: str, tmp_path: Path, call_tool: Callable[[str], None], capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "nowhere.txt").touch()  # no folder
    with contextlib.chdir(tmp_path), pytest.raises(SystemExit) as ended:
        call_tool(words)
    assert ended.value.code == 2 and "nowhere" in capsys.readouterr().err.splitlines()[-1]


def test_missing_extra_is_one_line() -> None:
    hidden = "import runpy, sys; sys.modules['torch'] = None; "
    run = "runpy.run_module('tools.training.export_reader', run_name='__main__')"
    done = subprocess.run([sys.executable, "-c", hidden + run], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr == "this needs torch; install it with: pip install '.[train]'\n"


def test_every_module_of_an_extra_is_known_with_it() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    named = {"skimage": "scikit-image", "pillow_heif": "pillow-heif"}
    for module, extra in EXTRA_OF.items():
        assert any(line.startswith(named.get(module, module)) for line in extras[extra])
    imported = {name for path in (ROOT / "tools").rglob("*.py") for name in third_party(path)}
    required = {"cv2", "numpy", "onnxruntime", "PIL", "pycolmap", "scipy", "tools", "tqdm"}
    assert imported - required == set(EXTRA_OF)


def threads(_: int) -> tuple[list[str | None], int]:
    """Report the limits that this process sees."""
    return [os.environ.get(name) for name in THREAD_COUNTS], cv2.getNumThreads()


def test_workers_have_one_thread() -> None:
    with single_threaded_pool(1) as pool:
        assert pool.map(threads, [0]) == [(["1"] * len(THREAD_COUNTS), 1)]
    with pytest.raises(RuntimeError, match="stop"), single_threaded_pool(1):
        raise RuntimeError("stop")
