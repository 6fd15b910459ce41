"""What processes that were killed leave beside results is removed, and nothing else."""

import os
import subprocess
import sys
from pathlib import Path

from blur2view.colmap.database import write_database
from blur2view.output_files import remove_left_over
from tests.colmap.test_link import link
from tests.support.colmap_projects import make_project, some_views


def test_only_left_over_files_of_dead_processes_and_planned_results_are_removed(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    names = (
        f".a.json.{ended.pid}.tmp",
        f".a.json.{os.getpid()}.tmp",  # of a call that runs beside this one
        f".b.json.{ended.pid}.tmp",  # no result of this call
        ".a.json.x.tmp",
        f"a.json.{ended.pid}.tmp",
    )
    for name in names:
        (tmp_path / name).touch()
    remove_left_over({tmp_path / "a.json"}, [tmp_path])
    assert {path.name for path in tmp_path.iterdir()} == set(names[1:])


def test_the_next_call_on_a_database_removes_what_a_killed_one_left_beside_it(tmp_path: Path) -> None:
    project = tmp_path / "project.db"
    make_project(project)
    for name in (".new.db.999999999.tmp", ".project.db.999999999.tmp"):
        (tmp_path / name).touch()
    write_database(tmp_path / "new.db", [some_views("a.jpg", 30)])
    link(project, "a_000.jpg", backup=True)
    assert not list(tmp_path.glob(".*"))
