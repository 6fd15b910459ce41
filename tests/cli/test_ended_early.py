"""Runs that are stopped, interrupted or killed: what is kept, and gone on with."""

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from blur2view import output
from blur2view.cli.batch import photograph
from blur2view.cli.batch import run as command
from blur2view.errors import OutputError
from blur2view.images.image import read_picture
from blur2view.output import write_files
from tests.support.calls import Call
from tests.support.many_photographs import ROOT, contents, start, write_photographs

SIGNALS = pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is another signal there")


def wait_for(running: subprocess.Popen[str], folder: Path, count: int) -> None:
    """Wait until a folder holds as many results."""
    while running.poll() is None and len(list(folder.glob("*.json"))) < count:
        time.sleep(0.01)


def test_full_disk_in_mid_run_stops_it_with_one_line_and_is_gone_on_from(
    run: Call, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read: list[str]
) -> None:
    room = iter(range(3))

    def full(files: Any, **how: Any) -> None:
        if next(room, None) is None:
            raise OSError(28, "No space left on device")
        write_files(files, **how)

    with monkeypatch.context() as patched:
        patched.setattr(output, "write_files", full)
        error, stopped = run(folder, "-o", tmp_path / "out").lines
    assert "No space left on device" in error
    assert stopped.startswith("blur2view: stopped after 3 of 5 photographs")
    read.clear()
    assert run(folder, "-o", tmp_path / "out", "--resume") == 0
    assert read == ["003.png", "004.png"]


def test_a_table_that_cannot_be_written_costs_no_other_result(
    call: Call, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(target: Path, content: bytes, **_: object) -> None:
        raise OutputError(f"{target}: no room")

    monkeypatch.setattr(command, "write_file", full)
    done = call("to-colmap", folder, "--db", tmp_path / "new.db", "--csv", tmp_path / "t.csv")
    assert done == 1 and done.line == f"blur2view: {tmp_path / 't.csv'}: no room"
    assert (tmp_path / "new.db").is_file()


def test_interrupt_keeps_what_is_done_says_how_to_go_on_and_writes_a_page_of_it(
    call: Call, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(path: Path, **options: Any) -> Any:
        if path.name == "003.png":
            raise KeyboardInterrupt
        return read_picture(path, **options)

    with monkeypatch.context() as patched:
        patched.setattr(photograph, "read_picture", interrupt)
        done = call("estimate", folder, "-o", tmp_path / "out")
        assert call("report", folder, "--no-mask", "-o", tmp_path / "page.html") == 130
        assert call("estimate", folder / "003.png").err == "blur2view: interrupted\n"
        assert call("to-colmap", folder, "--db", tmp_path / "new.db") == 130
    assert done == 130 and done.err == (
        "blur2view: interrupted after 3 of 5 photographs; the same call with --resume does the rest\n"
    )
    assert "3 photographs" in (tmp_path / "page.html").read_text() and not (tmp_path / "new.db").exists()
    done = call("estimate", folder, "-o", tmp_path / "out", "--resume")
    assert done == 0 and "2 done, 3 done before" in done.out


@pytest.mark.slow
def test_killed_run_goes_on_to_what_an_undisturbed_one_gives(
    run: Call, tmp_path: Path, tiny_model: Path
) -> None:
    write_photographs(tmp_path / "in", 16)
    assert run(tmp_path / "in", "-o", tmp_path / "whole") == 0
    words = [tmp_path / "in", "--model", tiny_model]
    killed = start("estimate", *words, "--jobs", 2, "-o", tmp_path / "out", gate=tmp_path / "gate")
    wait_for(killed, tmp_path / "out", 3)
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    before = len(list((tmp_path / "out").glob("*.json")))
    done = run(tmp_path / "in", "-o", tmp_path / "out", "--resume")
    assert done == 0 and 3 <= before <= 8
    assert f"{16 - before} done, {before} done before" in done.out
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


@SIGNALS
@pytest.mark.slow
def test_interrupt_leaves_no_half_written_file(tmp_path: Path, tiny_model: Path) -> None:
    write_photographs(tmp_path / "in", 16)
    words = [tmp_path / "in", "--jobs", 2, "--model", tiny_model, "-o", tmp_path / "out"]
    running = start("estimate", *words, gate=tmp_path / "gate")
    wait_for(running, tmp_path / "out", 4)
    running.send_signal(signal.SIGINT)
    _, complaints = running.communicate()
    assert running.returncode == 130
    (line,) = complaints.splitlines()
    assert line.startswith("blur2view: interrupted after") and "--resume" in line
    assert not list((tmp_path / "out").glob(".*.tmp"))


PRESSED_IN = """
import importlib.abc, os, signal, sys, threading

class Pressed(importlib.abc.MetaPathFinder):
    def find_spec(self, name, *where):
        if name == {module!r} and threading.current_thread() is threading.main_thread():
            try:
                os.kill(os.getpid(), {signal})
            except KeyboardInterrupt as interrupt:
                raise ImportError("initialization failed") from interrupt

signal.signal(signal.SIGINT, signal.default_int_handler)  # jobs in the background ignore it
sys.meta_path.insert(0, Pressed())
sys.argv = ["blur2view", *{words}]
from blur2view.__main__ import program
sys.exit(program())
"""


@SIGNALS
@pytest.mark.parametrize(
    ("module", "words"),
    [
        ("blur2view.cli.start", ["--version"]),
        ("numpy", ["estimate", "models/sample.jpg"]),
        ("pycolmap", ["to-transforms", "."]),
    ],
)
def test_ctrl_c_within_an_import_that_makes_an_error_of_it_is_one(module: str, words: list[str]) -> None:
    pressed = PRESSED_IN.format(module=module, signal="signal.SIGINT", words=words)
    done = subprocess.run([sys.executable, "-c", pressed], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "blur2view: interrupted\n")


LOST = """
import _thread, os, signal, sys, time
from types import SimpleNamespace
from blur2view import __main__
from blur2view.cli import commands

delays = iter([{delay_s}])

def start_new_thread(*given):
    _thread.start_new_thread(*given)
    time.sleep(next(delays, 0))

class Freed:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)

def main():
    Freed()  # Python raises nothing that happens while it is freed
    time.sleep(60)

signal.signal(signal.SIGINT, signal.default_int_handler)
commands.main, __main__._thread = main, SimpleNamespace(start_new_thread=start_new_thread)
sys.exit(__main__.program())
"""


@SIGNALS
@pytest.mark.parametrize(
    "delay_s", [0, 0.1]
)  # of a busy machine, longer than the time until it is pressed anew
def test_ctrl_c_while_an_object_is_freed_is_not_lost(delay_s: float) -> None:
    lost = LOST.format(delay_s=delay_s)
    done = subprocess.run([sys.executable, "-c", lost], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "blur2view: interrupted\n")
