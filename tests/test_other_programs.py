"""No file makes another program run, an estimate opens no socket, and libraries get along."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.many_photographs import SAMPLE, command, environment

POSTSCRIPT = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 80 64\n%%EndComments\nshowpage\n"
TRAPS = ("gs", "djpeg", "convert", "ffmpeg", "dcraw", "exiftool", "colmap", "sh")
NAMES = ("a.jpg", "b.eps", "c.avi", "d.dng", "e.pdf")


@pytest.mark.skipif(os.name != "posix", reason="programs are found by their names on PATH")
def test_a_photograph_that_is_a_program_starts_none(tmp_path: Path) -> None:
    for name in NAMES:
        (tmp_path / name).write_bytes(POSTSCRIPT)
    for name in TRAPS:
        (tmp_path / name).write_text(f"#!{sys.executable}\nopen({str(tmp_path / 'ran')!r}, 'a')\n")
        (tmp_path / name).chmod(0o755)
    path = {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    words = command("estimate", "--jobs", "1", *NAMES)
    call = subprocess.run(words, cwd=tmp_path, env=environment() | path, capture_output=True, text=True)
    assert call.returncode == 1 and len(call.stderr.splitlines()) == len(NAMES), call.stderr
    assert "a.jpg: is not a readable image; convert it to JPEG, PNG or TIFF" in call.stderr
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("program", "warns"),
    [
        ("import pycolmap, blur2view", True),
        ("import blur2view, pycolmap", False),
        ("import zlib, pycolmap, blur2view", False),
    ],
)
def test_a_process_that_would_die_of_pycolmaps_zlib_is_warned(program: str, warns: bool) -> None:
    words = [sys.executable, "-W", "error::RuntimeWarning", "-c", program]
    call = subprocess.run(words, env=environment(), capture_output=True, text=True)
    assert ("import blur2view first" in call.stderr) == warns == (call.returncode != 0)


@pytest.mark.skipif(shutil.which("strace") is None, reason="needs strace")
def test_an_estimate_executes_nothing_but_python_and_opens_no_socket(tmp_path: Path) -> None:
    log = tmp_path / "log"
    trace = ["strace", "-f", "--seccomp-bpf", "-e", "trace=execve,connect,bind", "-o", str(log)]
    words = [*trace, *command("estimate", SAMPLE)]
    subprocess.run(words, cwd=tmp_path, env=environment(), check=True, capture_output=True)
    lines = log.read_text().splitlines()
    started = {Path(line.split('"')[1]).name for line in lines if "execve(" in line}
    started.discard("ldconfig")  # older libraries ask it for others
    assert len(started) == 1 and started.pop().startswith("python")
    assert not [line for line in lines if "AF_INET" in line]
