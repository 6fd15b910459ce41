"""Tools that are given what is not there say so in one line."""

import sys
from importlib import import_module
from pathlib import Path

import pytest


@pytest.mark.parametrize(
    "words",
    [
        "datasets.sample nowhere.txt/sample.jpg",
        "datasets.sample sample.jpg --photos nowhere",
        "evaluation.even_blur nowhere",
        "evaluation.gyroscope nowhere",
        "reconstruction.sfm_experiment --sequence nowhere",
        "reconstruction.time_direction --rendered nowhere",
        "reconstruction.two_image_models nowhere",
        "reports.figures nowhere",
        "reports.gallery nowhere/a.jpg --out a.webp",
        "reports.report_screenshot nowhere/a.jpg",
        "database_safety.malformed_projects --model nowhere",
    ],
)
def test_what_is_not_there_is_wrong_usage(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    name, *arguments = words.split()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "nowhere.txt").touch()  # no folder
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    with pytest.raises(SystemExit) as ended:
        import_module(f"tools.{name}").main()
    assert ended.value.code == 2 and "nowhere" in capsys.readouterr().err.splitlines()[-1]


def test_screenshot_says_that_it_needs_playwright(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "playwright.sync_api", None)
    monkeypatch.setattr(sys, "argv", ["report_screenshot", __file__])
    with pytest.raises(SystemExit):
        import_module("tools.reports.report_screenshot").main()
    assert "pip install playwright" in capsys.readouterr().err.splitlines()[-1]
