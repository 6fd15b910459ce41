"""The manifest finds what is done, and nothing else; damage costs what is damaged, and nothing is called."""

import ast
import json
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from blur2view.errors import OutputError
from blur2view.output_files import ResultFiles
from blur2view.results.report import Entry
from blur2view.results.stored import plain, restore
from blur2view.results.table import Row
from blur2view.runs import manifest as manifests
from blur2view.runs.job import Job, Made, Outcome, Work, file_digest, neighbours_of
from blur2view.runs.manifest import FORMAT, Manifest, Settings

SETTINGS = Settings(command="estimate", version="1", options={"seed": 0, "network": "ab"})
ENTRY = Entry(name="a.jpg", kind="proven", verdict="CALIBRATED", text="t", median_px=3.0, content="{}")
MADE = Made(kept=ENTRY, summary="two\nlines", row=Row(verdict="V", inliers=3))
Target = ResultFiles | None


@dataclass(frozen=True, kw_only=True)
class EntryWork(Work[Target, Entry]):
    """Work whose entries are kept."""

    def __call__(self, job: Job[Target]) -> Made[Entry]:
        """Return an entry."""
        return MADE

    def stored(self, kept: Entry) -> Any:
        """Return the entry in JSON's types."""
        return plain(kept)

    def restored(self, job: Job[Target], stored: Any) -> Entry:
        """Return the entry."""
        entry: Entry = restore(Entry, stored)
        return entry


WORK = EntryWork()


def job_in(folder: Path) -> Job[Target]:
    """Return a photograph with one file, a.json."""
    target = ResultFiles(folder=folder, stem="a", endings=(".json",))
    return Job(index=0, path=folder / "a.jpg", target=target, digest="12", source="s")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return a manifest in which one photograph is done, with one file."""
    (tmp_path / "a.json").write_text("result")
    append(tmp_path / "m.jsonl", outputs={tmp_path / "a.json": file_digest(tmp_path / "a.json")})
    return tmp_path / "m.jsonl"


def append(
    path: Path,
    settings: Settings = SETTINGS,
    name: str = "a.jpg",
    made: Made[Entry] | None = MADE,
    **more: Any,
) -> None:
    """Write down what became of a photograph."""
    job = replace(job_in(path.parent), path=path.parent / name)
    with Manifest(path, settings, resume=False) as manifest:
        manifest.append(job, Outcome(made=made, digest="12", **more), WORK)


def found(place: Path, settings: Settings = SETTINGS, **changes: Any) -> Made[Entry] | None:
    """Return what a later call finds in a manifest of the photograph."""
    with Manifest(place, settings, resume=True) as manifest:
        return manifest.find(replace(job_in(place.parent), **changes), WORK)


def complaint(path: Path, settings: Settings = SETTINGS) -> str:
    """Return what a call that goes on says of the manifest."""
    with Manifest(path, settings, resume=True) as manifest:
        return str(manifest.complaint or "")


def test_what_is_done_is_found_with_all_that_a_command_needs(path: Path) -> None:
    made = found(path)
    assert made is not None and made.kept == ENTRY and complaint(path) == ""
    assert made.summary == "two\nlines" and made.row == MADE.row
    with Manifest(path, SETTINGS, resume=False) as manifest:
        assert not manifest.knows(job_in(path.parent))
    for line in path.read_text().splitlines():
        assert isinstance(json.loads(line), dict)


def test_whatever_has_changed_is_not_found(path: Path) -> None:
    target = replace(job_in(path.parent).target, stem="b")  # type: ignore[type-var]
    for change in ({"digest": "13"}, {"source": "other"}, {"path": Path("b.jpg")}, {"target": target}):
        assert found(path, **change) is None
    for options in ({"seed": 1, "network": "ab"}, {"seed": 0, "network": "cd"}):
        assert found(path, replace(SETTINGS, options=options)) is None
    (path.parent / "a.json").write_text("resul")
    assert found(path) is None
    (path.parent / "a.json").unlink()
    assert found(path) is None


def test_a_neighbour_is_part_of_the_source_and_is_read_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ["a.jpg", "b.jpg", "c.jpg"]
    for name in names:
        (tmp_path / name).write_text(name)
    read: list[str] = []

    def noted(path: Path) -> str:
        read.append(path.name)
        return file_digest(path)

    monkeypatch.setattr(manifests, "file_digest", noted)
    beside = neighbours_of([tmp_path / name for name in names], sequence=True)
    start = replace(job_in(tmp_path), target=None)
    jobs = [replace(start, path=path, neighbours=near) for path, near in beside.items()]
    assert read == []  # nothing before the first photograph
    with Manifest(tmp_path / "m.jsonl", SETTINGS, resume=False) as manifest:
        for job in jobs:
            manifest.append(job, Outcome(made=MADE, digest="12"), WORK)
    assert sorted(read) == names
    for changed in ("", "another"):
        (tmp_path / "c.jpg").write_text(changed or "c.jpg")
        with Manifest(tmp_path / "m.jsonl", SETTINGS, resume=True) as manifest:
            known = [manifest.find(job, WORK) is not None for job in jobs]
        assert known == [True, not changed, True]


def test_failure_since_then_and_other_options_since_then_are_not_found(path: Path) -> None:
    other = replace(SETTINGS, options={"seed": 1})
    content = path.read_bytes()
    append(path, made=None, error="broken")
    assert found(path) is None
    path.write_bytes(content)
    append(path, other)
    assert found(path) is None and found(path, other, target=None) is not None


@pytest.mark.parametrize("keep", [1, 10, 0.5, -1])
def test_line_that_was_cut_off_is_dropped_and_the_others_are_kept(path: Path, keep: float) -> None:
    whole = path.read_bytes()
    append(path, name="b.jpg")
    added = path.read_bytes()[len(whole) :]
    path.write_bytes(whole + added[: round(keep * len(added)) if keep == 0.5 else int(keep)])
    b: dict[str, Any] = {"path": path.parent / "b.jpg", "target": None}
    assert "cut off" in complaint(path) and found(path) and found(path, **b) is None
    append(path, name="b.jpg")
    assert complaint(path) == "" and found(path) and found(path, **b)


def test_cut_off_in_its_first_line_it_is_still_ours(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:5])
    assert "cut off" in complaint(path) and found(path) is None
    append(path, made=None, error="broken")
    assert len(path.read_text().splitlines()) == 2


def test_manifest_of_another_version_is_done_again_with_one_line(path: Path) -> None:
    later = replace(SETTINGS, version="2")
    assert "is of another version of blur2view" in complaint(path, later) and found(path, later) is None
    append(path, later, name="b.jpg")
    assert complaint(path, later) == ""
    lines = path.read_text().splitlines()[:2]
    head = {name: value for name, value in json.loads(lines[0]).items() if name != "format"}
    path.write_text(json.dumps(head) + "\n" + lines[1] + "\n")  # as those were that held pickles
    assert FORMAT > 1 and "is of another version" in complaint(path)


def test_file_of_others_is_refused_and_stays(tmp_path: Path) -> None:
    path = tmp_path / "m.jsonl"
    path.write_text('{"mine": 1}\n')
    with pytest.raises(OutputError, match="is no manifest of blur2view"):
        Manifest(path, SETTINGS, resume=False)
    assert path.read_text() == '{"mine": 1}\n'


@pytest.mark.parametrize("kind", ["fifo", "/dev/zero", "/dev/null", "folder", "sparse"])
def test_what_is_no_file_of_ours_is_refused_at_once(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "m.jsonl"
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "sparse":
        path.touch()
        os.truncate(path, 8 << 30)
    else:
        path.symlink_to(kind)
    with pytest.raises(OutputError):
        Manifest(path, SETTINGS, resume=True)
    assert os.path.lexists(path)


def test_one_call_at_a_time_has_a_manifest_and_an_empty_one_is_removed(tmp_path: Path) -> None:
    path = tmp_path / "m.jsonl"
    with (
        Manifest(path, SETTINGS, resume=False),
        pytest.raises(OutputError, match="another call writes there"),
    ):
        Manifest(path, SETTINGS, resume=True)
    assert not path.exists()
    append(path)
    assert found(path, target=None) is not None


def test_full_disk_is_one_error_that_says_how_to_go_on(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: int, content: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(OutputError, match="No space left on device.*--resume"):
        append(path, made=None, error="broken")


def test_file_of_all_photographs_is_known_while_nobody_changes_it(path: Path) -> None:
    database = path.parent / "new.db"
    database.write_text("rows")

    def wrote() -> bool:
        with Manifest(path, SETTINGS, resume=True) as manifest:
            return manifest.wrote(database)

    assert not wrote()
    with Manifest(path, SETTINGS, resume=False) as manifest:
        manifest.append_target(database)
    assert wrote()
    database.write_text("more")
    assert not wrote()


CALLS = "os.mkdir"
"""What a pickle would have had called."""


@pytest.mark.parametrize(
    "change",
    [
        {"kept": {"__reduce__": [CALLS, ["evil"]], "__class__": "os.system"}},
        {"kept": "c-mkdirs%evil"},  # of an earlier version: base 85
        {"kept": {**plain(ENTRY), "name": {"__class__": CALLS}}},
        {"kept": {**plain(ENTRY), "median_px": [1.0]}},
        {"kept": {**plain(ENTRY), "median_px": True}},
        {"kept": {**plain(ENTRY), "more": 1}},
        {"kept": [ENTRY.name]},
        {"kept": 3},
        {"kept": None},
        {"sha256": None},
        {"source": None},
        {"summary": None},
        {"summary": ["a"]},
        {"outputs": ["a.json"]},
        {"outputs": {"a\0.json": ""}},
        {"outputs": {"a\ud800.json": ""}},
        {"outputs": {"a.json": 3}},
        {"row": [1]},
        {"row": {**plain(MADE.row), "smear_px": "far"}},
        {"row": {**plain(MADE.row), "unexpected": 1}},
        {"image": ["a.jpg"]},
        {"image": None},
    ],
)
def test_line_of_other_content_is_not_found_and_nothing_is_called(
    path: Path, change: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(path.parent)
    before = set(os.listdir())
    lines = path.read_text().splitlines()
    line = {key: value for key, value in (json.loads(lines[1]) | change).items() if value is not None}
    path.write_text(lines[0] + "\n" + json.dumps(line) + "\n")
    assert found(path) is None and set(os.listdir()) == before


@pytest.mark.parametrize(
    "text",
    ['{"target": "a"}', '{"target": ["a"], "sha256": "b"}', "[" * 99999, '{"a":' * 99999, "7", "[7]", '"x"']
    + ['{"x": NaN}', "9" * 9999, '{"blur2view": 1}', '{"blur2view": "1", "format": "2"}', "null"],
)
def test_line_that_makes_no_sense_is_dropped(path: Path, text: str) -> None:
    with path.open("a") as file:
        file.write(text + "\n")
    assert "cut off" in complaint(path) and found(path) is not None


def test_package_imports_nothing_that_calls_what_a_file_names() -> None:
    package = Path(__file__).parents[2] / "blur2view"
    unsafe = {"pickle", "cPickle", "_pickle", "shelve", "marshal", "dill", "cloudpickle", "joblib"}
    for source in package.rglob("*.py"):
        for node in ast.walk(ast.parse(source.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not unsafe & {name.split(".")[0] for name in names}, source
