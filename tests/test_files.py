"""Files: nothing is waited for, nothing without end is read; what a killed call leaves is replaced."""

import errno
import io
import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from blur2view.colmap.database import write_database
from blur2view.colmap.transforms import point_cloud
from blur2view.errors import OutputError
from blur2view.files import open_regular, read_regular
from blur2view.output import (
    SIGNATURES,
    check_file,
    half_written,
    is_ours,
    locked,
    note,
    signed,
    unwritable,
    writable_folder,
    write_file,
)
from blur2view.records.record import Record
from blur2view.results.gyroflow import gyroflow_log
from blur2view.results.overlay import png
from blur2view.results.page import page
from blur2view.smears.grid import stored_smears
from blur2view.smears.kernels import BlurKernels
from tests.colmap.test_link import link
from tests.support.colmap_projects import make_project, some_views
from tests.support.grids import grid_of

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


def test_the_next_call_removes_what_a_killed_one_left_half_written_and_no_other(tmp_path: Path) -> None:
    killed = subprocess.Popen([sys.executable, "-c", ""])
    killed.wait()
    running = half_written(tmp_path / "a.json")
    running.write_text("half")
    left = running.with_name(running.name.replace(f"-{os.getpid()}.", f"-{killed.pid}."))
    left.write_text("half")
    writable_folder(tmp_path)
    assert running.exists() and not left.exists()
    running.unlink()
    project = tmp_path / "project.db"
    make_project(project)
    write_database(tmp_path / "new.db", [some_views("a.jpg", 30)])
    link(project, "a_000.jpg", backup=True)
    write_file(tmp_path / "a.json", b"whole")
    assert (tmp_path / "a.json").read_bytes() == b"whole" and not list(tmp_path.glob(".*"))


def test_what_has_changed_since_it_was_noted_is_refused(tmp_path: Path) -> None:
    for name in ("table.csv", "a\nb \udcff.csv"):
        table = tmp_path / name
        for content in (b"name\n", b"name,use\n"):
            check_file(table)
            write_file(table, content, noted=True)
        table.write_bytes(b"name,use,label\n")
        with pytest.raises(OutputError, match="has changed since blur2view wrote it; move it away, or name"):
            check_file(table)


def test_a_call_killed_between_note_and_file_may_be_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_file(table := tmp_path / "table.csv", b"old", noted=True)
    with locked(tmp_path):
        note({table: "0" * 64})  # and killed before the file is written
    check_file(table)


@pytest.mark.skipif(sys.platform == "win32", reason="has no locks of folders")
def test_one_call_at_a_time_writes_in_a_folder_and_the_lock_of_a_killed_one_ends(tmp_path: Path) -> None:
    program = "import sys, pathlib; from blur2view.output import locked\n"
    program += "with locked(pathlib.Path(sys.argv[1])): print(flush=True); sys.stdin.read()"
    command, pipe = [sys.executable, "-c", program, str(tmp_path)], subprocess.PIPE
    holder = subprocess.Popen(command, stdin=pipe, stdout=pipe)
    assert holder.stdin is not None
    assert holder.stdout is not None and holder.stdout.readline()
    writer = threading.Thread(target=write_file, args=(tmp_path / "a", b"whole"))
    writer.start()
    writer.join(0.1)
    assert writer.is_alive() and not (tmp_path / "a").exists()
    holder.kill()
    holder.wait()
    holder.stdin.close()
    holder.stdout.close()
    writer.join()
    assert (tmp_path / "a").read_bytes() == b"whole"


def written_content() -> dict[str, bytes]:
    """Return what every writer of signed files writes, by the name of the format."""
    timed = Record(
        name="a", blur="camera moved", timestamp_s=1, exposure_s=1, time_known=True, wx=1, wy=0, wz=0
    )
    one = np.ones((1, 1), np.float32)
    kernels = BlurKernels(whole=one, cells=one[None, None].astype(np.float16), known=one > 0, stride=32)
    smears = io.BytesIO()
    np.savez(smears, allow_pickle=False, **stored_smears(grid_of(np.ones((2, 2, 2)))))
    return {
        "record": timed.to_json().encode(),
        "JSON": json.dumps(signed({"frames": []}, "1"), indent=2).encode(),
        "notes of recover": json.dumps(signed({"call_sha256": ""}, "recover")).encode(),
        "smears": smears.getvalue(),
        "kernels": kernels.to_npz(),
        "PNG": png(np.zeros((2, 2, 3), np.uint8)),
        "HTML": page("title", "", style="", version="1"),
        "PLY": point_cloud(pycolmap.Reconstruction()),
        "Gyroflow": gyroflow_log([timed], "a.mp4").encode(),
    }


@pytest.mark.parametrize("kind", written_content())
def test_what_each_writer_writes_is_ours_and_replaced_and_a_copy_without_its_mark_is_not(
    kind: str, tmp_path: Path
) -> None:
    content, path = written_content()[kind], tmp_path / "a"
    path.write_bytes(content)
    assert is_ours(path)
    (mark,) = {mark for mark in SIGNATURES if mark in content}
    path.write_bytes(content.replace(mark, mark[::-1]))
    with pytest.raises(OutputError, match="was not written by blur2view"):
        check_file(path)


def test_a_folder_that_takes_no_files_is_named_in_full(here: Path) -> None:
    refusal = unwritable(Path("."), OSError(errno.EROFS, os.strerror(errno.EROFS)))
    assert str(refusal) == (
        f"{here}: results cannot be written there (Read-only file system); name another folder"
    )
    full = unwritable(here, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    assert str(full).endswith("; free some space, or name another folder")


def test_a_link_to_itself_is_not_replaced_and_one_into_no_folder_makes_none(tmp_path: Path) -> None:
    (loop := tmp_path / "link").symlink_to("link")
    with pytest.raises(OutputError, match="link: is not a regular file; name another with --csv"):
        check_file(loop, option="--csv")
    (astray := tmp_path / "astray").symlink_to("nowhere/x")
    with pytest.raises(OutputError, match="results cannot be written there"):
        write_file(astray, b"content")
    assert not (tmp_path / "nowhere").exists()
