"""What processes that were killed leave beside results is removed, and nothing else."""

import os
import subprocess
import sys
from pathlib import Path

from blur2view.file_writing import remove_left_over


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
