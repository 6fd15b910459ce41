"""No file that a user names makes another program run."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.many_photographs import SAMPLE, command, environment
from tools.evaluation.fuzz import POSTSCRIPT, TRAPS

NAMES = ("a.jpg", "b.eps", "c.avi", "d.dng", "e.pdf")


@pytest.mark.skipif(os.name != "posix", reason="programs are found by their names on PATH")
def test_a_photograph_that_is_a_program_starts_none(tmp_path: Path) -> None:
    for name in NAMES:
        (tmp_path / name).write_bytes(POSTSCRIPT)
    for name in TRAPS:
        (tmp_path / name).write_text(f"#!{sys.executable}\nopen({str(tmp_path / 'ran')!r}, 'a')\n")
        (tmp_path / name).chmod(0o755)
    call = subprocess.run(
        command("estimate", "--jobs", "1", *NAMES),
        cwd=tmp_path,
        env=environment() | {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"},
        capture_output=True,
        text=True,
    )
    assert call.returncode == 1 and len(call.stderr.splitlines()) == len(NAMES), call.stderr
    assert "a.jpg: is not a readable image; convert it to JPEG, PNG or TIFF" in call.stderr
    assert not (tmp_path / "ran").exists()


@pytest.mark.skipif(shutil.which("strace") is None, reason="needs strace")
def test_an_estimate_executes_nothing_but_python(tmp_path: Path) -> None:
    log = tmp_path / "log"
    words = ["strace", "-f", "-e", "trace=execve", "-o", str(log), *command("estimate", SAMPLE)]
    subprocess.run(words, cwd=tmp_path, env=environment(), check=True, capture_output=True)
    started = [line.split('"')[1] for line in log.read_text().splitlines() if "execve(" in line]
    names = [
        Path(one).name for one in started if Path(one).name != "ldconfig"
    ]  # older libraries ask it for others
    assert len(names) == 1 and names[0].startswith("python")
