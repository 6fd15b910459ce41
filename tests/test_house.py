"""The linter, the formatter and the type checker, so that one command checks everything."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.lint

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "tools/results"
COMMANDS = re.findall(r"^\| `([\w.]+)` \|", (ROOT / "tools/README.md").read_text(), re.MULTILINE)


def check(*command: str) -> None:
    """Run a tool in the root of the checkout; it must find nothing."""
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"


def test_types_agree() -> None:
    pytest.importorskip("torch", reason="mypy reads the types of torch, which tools/ uses")
    check("mypy")


def test_linter_finds_and_formatter_changes_nothing() -> None:
    check("ruff", "check")
    check("ruff", "format", "--check")


def functions(path: Path) -> set[str]:
    """Return the names of a module's functions."""
    return {node.name for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef)}


def source(name: str) -> Path:
    """Return the file that ``python -m tools.NAME`` runs."""
    path = ROOT / "tools" / Path(*name.split("."))
    return path / "__main__.py" if path.is_dir() else path.with_suffix(".py")


def test_tools_readme_lists_every_command_and_no_other() -> None:
    there = {path for path in (ROOT / "tools").rglob("*.py") if "main" in functions(path)}
    listed = {source(name) for name in COMMANDS}
    assert listed == there and len(COMMANDS) == len(listed)


def test_every_result_is_in_the_index_with_a_command_that_exists() -> None:
    linked = re.findall(r"\]\(([\w./]+)\)", (RESULTS / "README.md").read_text())
    there = {str(path.relative_to(RESULTS)) for path in RESULTS.rglob("*") if path.is_file()}
    assert set(linked) == there - {"README.md"}
    commands = re.findall(r"`([a-z]+\.\w+)[ `]", (RESULTS / "README.md").read_text())
    assert len(set(commands)) > 10 and set(commands) <= set(COMMANDS)


def test_pictures_of_results_are_light() -> None:
    pictures = [path for path in RESULTS.rglob("*") if path.suffix in {".png", ".jpg", ".webp"}]
    assert sum(path.stat().st_size for path in pictures) < 3_000_000
