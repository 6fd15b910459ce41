"""Files: nothing is waited for, nothing without end is read; what a killed call leaves is replaced."""

import errno
import os
from pathlib import Path

import pytest

from blur2view.colmap.database import write_database
from blur2view.errors import OutputError
from blur2view.files import check_file, half_written, open_regular, read_regular, unwritable, write_file
from tests.colmap.test_link import link
from tests.support.colmap_projects import make_project, some_views

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


def test_the_next_call_replaces_what_a_killed_one_left_half_written(tmp_path: Path) -> None:
    project = tmp_path / "project.db"
    make_project(project)
    for path in (project, tmp_path / "new.db", tmp_path / "a.json"):
        half_written(path).write_text("half")
    write_database(tmp_path / "new.db", [some_views("a.jpg", 30)])
    link(project, "a_000.jpg", backup=True)
    write_file(tmp_path / "a.json", b"whole")
    assert (tmp_path / "a.json").read_bytes() == b"whole" and not list(tmp_path.glob(".*"))


def test_a_folder_that_takes_no_files_is_named_in_full(here: Path) -> None:
    refusal = unwritable(Path("."), OSError(errno.EROFS, os.strerror(errno.EROFS)))
    assert str(refusal).startswith(f"{here}: results cannot be written there (Read-only file system)")


def test_a_link_to_itself_is_not_replaced_and_one_into_no_folder_makes_none(tmp_path: Path) -> None:
    (loop := tmp_path / "link").symlink_to("link")
    with pytest.raises(OutputError, match="link: is no regular file; name another with --csv"):
        check_file(loop, option="--csv")
    (astray := tmp_path / "astray").symlink_to("nowhere/x")
    with pytest.raises(OutputError, match="results cannot be written there"):
        write_file(astray, b"content")
    assert not (tmp_path / "nowhere").exists()
