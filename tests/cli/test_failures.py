"""What fails, on whichever side of the program: one line each, and never a traceback."""

import shlex
import subprocess
import sys
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from blur2view.cli.batch import photograph as over_photographs
from blur2view.cli.to_transforms import ToTransformsOptions
from blur2view.files import quick_digest
from blur2view.pipeline import estimate
from tests.support.calls import Call, call_program
from tests.support.many_photographs import SAMPLE, command, environment


@pytest.mark.parametrize("raised", [MemoryError(), cv2.error("Failed to allocate")])
def test_too_little_memory_costs_one_photograph(
    run: Call, still: Path, moving: Path, monkeypatch: pytest.MonkeyPatch, raised: Exception
) -> None:
    if isinstance(raised, cv2.error):
        raised.code = -4
    calls = iter([raised])

    def stumble(*arguments: object, **options: object) -> Any:
        for error in calls:
            raise error
        return estimate(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(over_photographs, "estimate", stumble)
    printed = run(moving, still)
    assert printed == 1
    assert printed.err == f"blur2view: {moving}: does not fit in memory; resize it\n"
    assert f"{still.name}: Sharp" in printed.out


def program(*words: object, closed: str = "") -> subprocess.CompletedProcess[str]:
    """Run the program in a process of its own, without some of its standard streams."""
    line = f"{shlex.join(command(*words))} {closed}"
    buffered = environment() | {"PYTHONUNBUFFERED": ""}
    return subprocess.run(line, shell=True, env=buffered, capture_output=True, text=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("closed", "out", "err"), [(">&-", 0, 1), ("2>&-", 2, 0), ("<&- >&- 2>&-", 0, 0), ("> /dev/full", 0, 1)]
)
def test_closed_streams_are_no_traceback(
    still: Path, tiny_model: Path, tmp_path: Path, closed: str, out: int, err: int
) -> None:
    done = program("estimate", still, tmp_path / "absent.png", "--model", tiny_model, closed=closed)
    assert done.returncode == 1
    assert (len(done.stdout.splitlines()), len(done.stderr.splitlines())) == (out, err)


@pytest.mark.slow
def test_nobody_else_prints(tmp_path: Path, tiny_model: Path) -> None:
    content = cv2.imencode(".png", np.zeros((64, 80, 3), np.uint16))[1].tobytes()
    chunk = b"tRNS" + bytes(7)  # of colour it has 6 bytes, of which libpng warns
    chunk = (7).to_bytes(4, "big") + chunk + zlib.crc32(chunk).to_bytes(4, "big")
    (tmp_path / "a.png").write_bytes(content[:33] + chunk + content[33:])
    done = program("estimate", tmp_path / "a.png", tmp_path / "absent.png", "--model", tiny_model)
    assert done.returncode == 1 and "a.png: Too dark" in done.stdout
    assert done.stderr == f"blur2view: {tmp_path / 'absent.png'}: no such file; check the path\n"


@pytest.mark.slow
def test_a_reader_that_wants_no_more_ends_the_call_as_it_ends_other_programs(
    still: Path, tiny_model: Path
) -> None:
    words = command("estimate", still, "--model", tiny_model)
    with subprocess.Popen(
        words, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as running:
        assert running.stdout is not None and running.stderr is not None
        running.stdout.close()
        assert running.stderr.read() == b""
    assert running.returncode == 141


@pytest.mark.slow
@pytest.mark.parametrize("words", ["--version", "estimate --help"])
def test_help_that_cannot_be_printed_is_a_failure(words: str) -> None:
    done = program(*words.split(), closed="> /dev/full")
    assert done.returncode == 1 and "cannot be used (No space left on device)" in done.stderr


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (ImportError("cv2.so: failed to map segment"), "a library cannot be loaded (cv2.so: failed"),
        (RuntimeError("\nCannot import the C++ backend"), "a library cannot be loaded (Cannot import"),
        (RuntimeError("can't start new thread"), "too little memory; free some\n"),
        (MemoryError(), "too little memory; free some\n"),
    ],
)
def test_little_memory_is_one_line_without_an_option_that_is_not_there(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, error: Exception, line: str
) -> None:
    def fails(options: object) -> None:
        raise error

    monkeypatch.setattr(ToTransformsOptions, "execute", fails)
    done = call_program(capsys, "to-transforms", "model")
    assert done == 1 and done.err.startswith(f"blur2view: {line}") and done.err.count("\n") == 1


def test_a_video_of_a_tebibyte_is_not_read_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("blur2view.files.READ_PART", 1 << 20)  # of a start and an end of holes
    with (tmp_path / "clip.mp4").open("wb") as video:
        video.truncate(1 << 40)
    first = quick_digest(tmp_path / "clip.mp4")
    with (tmp_path / "clip.mp4").open("r+b") as video:
        video.write(b"otherwise")
    assert len(first) == 64 and quick_digest(tmp_path / "clip.mp4") != first


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="it limits no address space")
@pytest.mark.parametrize(
    ("mib", "words"),
    [
        (400, ("recover", "model", "frames", "-o", "all")),
        (400, ("--version",)),
        (1200, ("estimate", str(SAMPLE), "--jobs", "1")),
    ],
)
def test_an_address_space_that_is_too_small_is_one_line_that_says_what_limits_it(
    mib: int, words: Sequence[str]
) -> None:
    limited = f"ulimit -v {mib << 10}; exec {shlex.join([sys.executable, '-m', 'blur2view', *words])}"
    done = subprocess.run(limited, shell=True, env=environment(), capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == (
        f"blur2view: too little memory; allow a larger address space than {mib} MiB with ulimit -v\n"
    )
