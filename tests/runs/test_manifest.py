"""The manifest finds what is done, and nothing else; damage costs what is damaged, and nothing is called."""

import ast
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from blur2view.errors import OutputError
from blur2view.results.table import Row
from blur2view.runs.job import Job, Outcome, file_digest, neighbours_of
from blur2view.runs.manifest import opened

SETTINGS: Any = {"command": "estimate", "version": "1", "options": {"seed": 0, "network": "ab"}}
DONE = Outcome(payload="views", summary="two\nlines", row=Row(verdict="V", inliers=3))


def job_in(folder: Path) -> Job:
    """Return a photograph with one file, a.json."""
    return Job(index=0, path=folder / "a.jpg", files=(folder / "a.json",), source="s")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return a manifest in which one photograph is done, with one file."""
    (tmp_path / "a.json").write_text('"document"')
    for name in ("a.jpg", "b.jpg", "c.jpg"):
        (tmp_path / name).write_text(name)
    append(tmp_path / "m.jsonl", outputs={tmp_path / "a.json": file_digest(tmp_path / "a.json")})
    return tmp_path / "m.jsonl"


def append(path: Path, name: str = "a.jpg", **more: Any) -> None:
    """Write down what became of a photograph."""
    with opened(path, **SETTINGS, resume=False) as manifest:
        photograph = path.parent / name
        done = replace(DONE, digest=file_digest(photograph), **more)
        manifest.append(replace(job_in(path.parent), path=photograph), done)


def found(place: Path, settings: Any = SETTINGS, **changes: Any) -> Outcome | None:
    """Return what a later call finds in a manifest of the photograph."""
    with opened(place, **settings, resume=True) as manifest:
        return manifest.find(replace(job_in(place.parent), **changes))


def complaint(path: Path, settings: Any = SETTINGS) -> str:
    """Return what a call that goes on says of the manifest."""
    with opened(path, **settings, resume=True) as manifest:
        return str(manifest.complaint or "")


def test_what_another_version_made_is_not_found(path: Path) -> None:
    later = SETTINGS | {"version": "2"}
    assert found(path, later) is None and "is of another version of blur2view" in complaint(path, later)


def test_a_neighbour_is_part_of_the_source(tmp_path: Path) -> None:
    names = ["a.jpg", "b.jpg", "c.jpg"]
    for name in names:
        (tmp_path / name).write_text(name)
    beside = neighbours_of([tmp_path / name for name in names], sequence=True)
    start = replace(job_in(tmp_path), files=())
    jobs = [replace(start, path=path, neighbours=near) for path, near in beside.items()]
    with opened(tmp_path / "m.jsonl", **SETTINGS, resume=False) as manifest:
        for job in jobs:
            manifest.append(job, replace(DONE, digest=file_digest(job.path)))
    (tmp_path / "c.jpg").write_text("another")
    with opened(tmp_path / "m.jsonl", **SETTINGS, resume=True) as manifest:
        assert [manifest.find(job) is not None for job in jobs] == [True, False, False]


@pytest.mark.parametrize("keep", [20, -1])
def test_line_that_was_cut_off_is_dropped_and_the_others_are_kept(path: Path, keep: int) -> None:
    whole = path.read_bytes()
    b: dict[str, Any] = {"path": path.parent / "b.jpg", "files": ()}
    append(path, "b.jpg")
    path.write_bytes(whole + path.read_bytes()[len(whole) :][:keep])
    assert found(path) is not None and (keep < 0 or found(path, **b) is None)  # -1: its end alone
    append(path, "c.jpg")
    append(path, "b.jpg")
    assert complaint(path) == "" and found(path) is not None and found(path, **b) is not None


@pytest.mark.parametrize("text", ["[" * 99999, '{"x": NaN}', '{"blur2view": 1}', "CHANGED"])
def test_line_that_makes_no_sense_or_was_changed_is_dropped(path: Path, text: str) -> None:
    append(path, "b.jpg")
    line = path.read_text().splitlines()[-1].replace('"inliers": 3', '"inliers": 4')
    with path.open("a") as file:
        file.write((line if text == "CHANGED" else text) + "\n")
    assert "cut off or changed" in complaint(path) and found(path) is not None
    kept = found(path, path=path.parent / "b.jpg", files=())
    assert kept is not None and kept.row.inliers == 3


@pytest.mark.parametrize("kind", ["theirs", "fifo"])
def test_what_is_no_manifest_of_ours_is_refused_at_once_and_stays(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "m.jsonl"
    if kind == "fifo":
        os.mkfifo(path)
    else:
        path.write_text('{"mine": 1}\n')
    with pytest.raises(OutputError), opened(path, **SETTINGS, resume=True):
        pass
    assert os.path.lexists(path) and (kind != "theirs" or path.read_text() == '{"mine": 1}\n')


def test_one_call_at_a_time_has_a_manifest_and_an_empty_one_is_removed(tmp_path: Path) -> None:
    path = tmp_path / "m.jsonl"
    with (
        opened(path, **SETTINGS, resume=False),
        pytest.raises(OutputError, match="another call writes there"),
        opened(path, **SETTINGS, resume=True),
    ):
        pass
    assert not path.exists()


def test_package_imports_nothing_that_calls_what_a_file_names() -> None:
    package = Path(__file__).parents[2] / "blur2view"
    unsafe = {"pickle", "cPickle", "_pickle", "shelve", "marshal", "dill", "cloudpickle", "joblib"}
    for source in package.rglob("*.py"):
        for node in ast.walk(ast.parse(source.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not unsafe & {name.split(".")[0] for name in names}, source
