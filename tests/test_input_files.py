"""Files of anybody: nothing is waited for, nothing without end is read."""

import os
from pathlib import Path

import pytest

from blur2view.input_files import open_regular, read_regular

LINUX = Path("/proc/self/mem").exists()


def test_content_comes_back_whole(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(bytes(range(256)))
    assert read_regular(tmp_path / "a", 256) == bytes(range(256))
    with pytest.raises(OSError, match="larger than 0 MiB"):
        read_regular(tmp_path / "a", 255)


@pytest.mark.skipif(not LINUX, reason="these files are Linux's")
@pytest.mark.parametrize(
    "name", ["/dev/zero", "/dev/tty", "/proc/kmsg", "/proc/self/comm", "pipe", ".", "absent", "a\0b"]
)
def test_what_may_never_end_is_not_opened(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError):
        open_regular(tmp_path / name)
