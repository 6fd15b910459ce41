"""The linter, the formatter and the type checker, so that one command checks everything."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.lint

ROOT = Path(__file__).resolve().parents[1]


def check(*command: str) -> None:
    """Run a tool in the root of the checkout; it must find nothing."""
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"


def test_types_agree() -> None:
    pytest.importorskip("torch", reason="mypy reads the types of torch, which tools/ uses")
    check("mypy")


def test_linter_finds_nothing() -> None:
    check("ruff", "check")


@pytest.mark.skip(reason="blur2view/errors.py is not formatted yet")
def test_formatter_changes_nothing() -> None:
    check("ruff", "format", "--check")


def test_pictures_of_results_are_light() -> None:
    pictures = [p for p in (ROOT / "tools/results").rglob("*") if p.suffix in {".png", ".jpg", ".webp"}]
    assert sum(picture.stat().st_size for picture in pictures) < 3_000_000
