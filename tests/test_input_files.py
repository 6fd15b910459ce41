"""Files of anybody: nothing is waited for, nothing without end is read, no JSON but such as ours is taken."""

import io
import os
from pathlib import Path

import pytest

from blur2view.input_files import open_regular, read_regular, read_stream

LINUX = Path("/proc/self/mem").exists()


def test_content_comes_back_whole(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(bytes(range(256)))
    assert read_regular(tmp_path / "a", 256) == bytes(range(256))
    with pytest.raises(OSError, match="larger than 0 MiB"):
        read_regular(tmp_path / "a", 255)


@pytest.mark.skipif(not LINUX, reason="these files are Linux's")
@pytest.mark.parametrize("name", ["/dev/zero", "/dev/random", "/dev/tty", "pipe", ".", "absent", "a\0b"])
def test_what_may_never_end_is_not_opened(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError):
        open_regular(tmp_path / name)


@pytest.mark.skipif(not LINUX, reason="these files are Linux's")
@pytest.mark.parametrize("name", ["/proc/kmsg", "/proc/self/mem", "/proc/self/comm"])
def test_what_says_that_it_is_empty_and_is_not_is_refused(name: str) -> None:
    with pytest.raises(OSError):
        open_regular(name)


@pytest.mark.skipif(not LINUX, reason="these files are Linux's")
def test_a_stream_without_end_is_left() -> None:
    with open("/dev/zero", "rb") as endless, pytest.raises(OSError, match="larger than 1 MiB"):
        read_stream(endless, 1 << 20)
    assert read_stream(io.BytesIO(b"abc"), 3) == b"abc"
