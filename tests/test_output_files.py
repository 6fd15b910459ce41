"""What a call that was killed leaves beside results is gone after the next one."""

import errno
import os
from pathlib import Path

from blur2view.colmap.database import write_database
from blur2view.output_files import half_written, remove_half_written, unwritable
from tests.colmap.test_link import link
from tests.support.colmap_projects import make_project, some_views


def test_the_next_call_on_a_database_removes_what_a_killed_one_left_beside_it(tmp_path: Path) -> None:
    project = tmp_path / "project.db"
    make_project(project)
    for name in (".new.db.999999999.blur2view.tmp", ".project.db.999999999.blur2view.tmp"):
        (tmp_path / name).write_text("half")
    write_database(tmp_path / "new.db", [some_views("a.jpg", 30)])
    link(project, "a_000.jpg", backup=True)
    assert not list(tmp_path.glob(".*"))


def test_what_running_processes_write_stays(tmp_path: Path) -> None:
    running = half_written(tmp_path / "a.json")
    parent, mine = tmp_path / f".b.json.{os.getppid()}.blur2view.tmp", tmp_path / ".c.blur2view.tmp"
    dead = tmp_path / ".d.json.999999999.blur2view.tmp"
    for path in (running, parent, mine, dead):
        path.touch()
    remove_half_written(tmp_path)
    assert set(tmp_path.iterdir()) == {running, parent, mine}


def test_a_folder_that_takes_no_files_is_named_in_full(here: Path) -> None:
    refusal = unwritable(Path("."), OSError(errno.EROFS, os.strerror(errno.EROFS)))
    assert str(refusal).startswith(f"{here}: results cannot be written there (Read-only file system)")
