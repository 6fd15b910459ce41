"""What a call that was killed leaves beside results is gone after the next one."""

from pathlib import Path

from blur2view.colmap.database import write_database
from tests.colmap.test_link import link
from tests.support.colmap_projects import make_project, some_views


def test_the_next_call_on_a_database_removes_what_a_killed_one_left_beside_it(tmp_path: Path) -> None:
    project = tmp_path / "project.db"
    make_project(project)
    for name in (".new.db.blur2view.tmp", ".project.db.blur2view.tmp"):
        (tmp_path / name).write_text("half")
    write_database(tmp_path / "new.db", [some_views("a.jpg", 30)])
    link(project, "a_000.jpg", backup=True)
    assert not list(tmp_path.glob(".*"))
