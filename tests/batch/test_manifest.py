"""The manifest finds what is done, and nothing else; damage costs what is damaged."""

import base64
import json
import os
import pickle
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blur2view.batch.job import Job, Made, Outcome, file_digest
from blur2view.batch.manifest import Manifest, Settings, _packed, _unpacked
from blur2view.cli.outputs import OutputFiles
from blur2view.errors import OutputError
from blur2view.exposure.views import ExposureViews
from blur2view.geometry.two_view_geometry import Configuration, TwoViewGeometry
from blur2view.visualization.report import Entry

SETTINGS = Settings(command="estimate", version="1", options={"seed": 0}, files={"model": "ab"})
JOB: Job[None] = Job(index=0, path=Path("a.jpg"), target=None, digest="12", source="s")
ENTRY = Entry(name="a.jpg", kind="found", verdict="CALIBRATED", text="t", median_px=3.0, content="{}")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return a manifest in which one photograph is done, with one file."""
    (tmp_path / "a.json").write_text("result")
    outputs = {tmp_path / "a.json": file_digest(tmp_path / "a.json")}
    made = Made(kept=ENTRY, summary="two\nlines", row={"x": 1})
    outcome = Outcome(made=made, digest="12", outputs=outputs)
    Manifest(tmp_path / "m.jsonl", SETTINGS, resume=False).append(JOB, outcome, tmp_path)
    return tmp_path / "m.jsonl"


def found(path: Path, job: Job[None] = JOB, settings: Settings = SETTINGS) -> Made[Any] | None:
    """Return what a later call finds."""
    return Manifest(path, settings, resume=True).find(job, path.parent)


def test_what_is_done_is_found_with_all_that_a_command_needs(path: Path) -> None:
    made = found(path)
    assert made is not None and made.kept == ENTRY
    assert made.summary == "two\nlines" and made.row == {"x": 1}
    assert not Manifest(path, SETTINGS, resume=False).knows(JOB)
    for line in path.read_text().splitlines():
        assert isinstance(json.loads(line), dict)


def test_whatever_has_changed_is_not_found(path: Path) -> None:
    assert found(path, replace(JOB, digest="13")) is None
    assert found(path, replace(JOB, source="other")) is None
    assert found(path, replace(JOB, path=Path("b.jpg"))) is None
    assert found(path, settings=replace(SETTINGS, options={"seed": 1})) is None
    assert found(path, settings=replace(SETTINGS, files={"model": "cd"})) is None
    (path.parent / "a.json").write_text("resul")
    assert found(path) is None
    (path.parent / "a.json").unlink()
    assert found(path) is None


def test_failure_since_then_and_other_options_since_then_are_not_found(path: Path) -> None:
    other = replace(SETTINGS, options={"seed": 1})
    content = path.read_bytes()
    Manifest(path, SETTINGS, resume=False).append(JOB, Outcome(error="broken"), path.parent)
    assert found(path) is None
    path.write_bytes(content)
    Manifest(path, other, resume=False).append(
        JOB, Outcome(made=Made(kept=ENTRY, summary=""), digest="12"), path.parent
    )
    assert found(path) is None and found(path, settings=other) is not None


@pytest.mark.parametrize("keep", [1, 10, 0.5, -1])
def test_line_that_was_cut_off_is_dropped_and_the_others_are_kept(path: Path, keep: float) -> None:
    whole = path.read_bytes()
    second = replace(JOB, path=Path("b.jpg"))
    outcome: Outcome[Entry] = Outcome(made=Made(kept=ENTRY, summary=""), digest="12")
    Manifest(path, SETTINGS, resume=False).append(second, outcome, path.parent)
    added = path.read_bytes()[len(whole) :]
    cut = round(keep * len(added)) if keep == 0.5 else int(keep)
    path.write_bytes(whole + added[:cut])
    manifest = Manifest(path, SETTINGS, resume=True)
    assert manifest.cut_off and manifest.knows(JOB) and not manifest.knows(second)
    manifest.append(second, outcome, path.parent)
    again = Manifest(path, SETTINGS, resume=True)
    assert not again.cut_off and again.knows(JOB) and again.knows(second)


def test_cut_off_in_its_first_line_it_is_still_ours(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:5])
    manifest = Manifest(path, SETTINGS, resume=True)
    assert manifest.cut_off and not manifest.knows(JOB)
    manifest.append(JOB, Outcome(error="broken"), path.parent)
    assert len(path.read_text().splitlines()) == 2


def test_file_of_others_is_refused_and_stays(tmp_path: Path) -> None:
    path = tmp_path / "m.jsonl"
    path.write_text('{"mine": 1}\n')
    with pytest.raises(OutputError, match="is no manifest of blur2view"):
        Manifest(path, SETTINGS, resume=False)
    assert path.read_text() == '{"mine": 1}\n'


def test_full_disk_is_one_error_that_says_how_to_go_on(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: int, content: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(OutputError, match="No space left on device.*--resume"):
        Manifest(path, SETTINGS, resume=True).append(JOB, Outcome(error="broken"), path.parent)


def test_file_of_all_photographs_is_known_while_nobody_changes_it(path: Path) -> None:
    database = path.parent / "new.db"
    database.write_text("rows")
    assert not Manifest(path, SETTINGS, resume=True).wrote(database)
    Manifest(path, SETTINGS, resume=False).append_target(database)
    assert Manifest(path, SETTINGS, resume=True).wrote(database)
    database.write_text("more")
    assert not Manifest(path, SETTINGS, resume=True).wrote(database)


def test_arrays_and_enums_come_back_as_they_were() -> None:
    mask = np.array([True, False])
    geometry = TwoViewGeometry(
        F=np.eye(3), config=Configuration.UNCALIBRATED, reason="r", inlier_mask=mask, swapped=~mask
    )
    views = ExposureViews(
        name="a.jpg", size=(4, 5), points_open=np.ones((2, 2)), points_close=np.zeros((2, 2)),
        sigma_px=np.ones(2), geometry=geometry, camera=None,
    )  # fmt: skip
    back = _unpacked(_packed(views))
    assert back.geometry.config is Configuration.UNCALIBRATED and back.size == (4, 5)
    np.testing.assert_array_equal(back.geometry.F, np.eye(3))
    np.testing.assert_array_equal(back.geometry.inlier_mask, mask)


def packed(pickled: bytes) -> str:
    """Return pickled bytes as a manifest has them."""
    return base64.b85encode(zlib.compress(pickled)).decode()


class _Evil:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("evil",)


class _OursButNoType:
    def __reduce__(self) -> tuple[Any, ...]:
        return file_digest, (Path("secret"),)


@pytest.mark.parametrize("thing", [_Evil(), _OursButNoType()])
def test_no_function_is_called_by_reading_a_manifest(
    path: Path, thing: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(path.parent)
    text = packed(pickle.dumps(thing))
    with pytest.raises(pickle.UnpicklingError, match="none of ours"):
        _unpacked(text)
    lines = path.read_text().splitlines()
    path.write_text(lines[0] + "\n" + json.dumps(json.loads(lines[1]) | {"kept": text}) + "\n")
    assert found(path) is None and not (path.parent / "evil").exists()


GLOBAL = b"\x80\x04cblur2view.cli.outputs\nOutputFiles\n"
MEMBER = b"\x80\x04cblur2view.geometry.two_view_geometry\nConfiguration\n(X\x06\x00\x00\x00PLANARtR"
STATE = b"}X\x08\x00\x00\x00documentX\x05\x00\x00\x00/evils"
OF_MEMBER = b"}X\x07\x00\x00\x00_value_K\x63s"


@pytest.mark.parametrize(
    "pickled",
    [
        GLOBAL + b"N" + STATE + b"\x86b.",  # (None, {...}): attributes of the class
        GLOBAL + b")\x81N" + STATE + b"\x86b.",  # the same of an object
        GLOBAL + STATE + b"b.",
        MEMBER + OF_MEMBER + b"b.",
    ],
)
def test_no_class_or_member_is_changed_by_reading_a_manifest(pickled: bytes) -> None:
    document, values = OutputFiles.__dict__["document"], [one.value for one in Configuration]
    try:
        with pytest.raises(pickle.UnpicklingError, match="none of ours"):
            _unpacked(packed(pickled))
        assert OutputFiles.__dict__["document"] is document
        assert [one.value for one in Configuration] == values
    finally:  # for the other tests
        OutputFiles.document = document  # type: ignore[method-assign]
        for one, value in zip(Configuration, values, strict=True):
            one._value_ = value


@pytest.mark.parametrize(
    "change",
    [
        {"kept": packed(b"cblur2view.nowhere\nEntry\n.")},  # ImportError
        {"kept": packed(b"h\x05.")},  # of the memo: KeyError or UnpicklingError
        {"kept": packed(b"0.")},  # IndexError
        {"kept": packed(b"")},
        {"kept": 3},
        {"kept": None},
        {"sha256": None},
        {"source": None},
        {"summary": None},
        {"outputs": ["a.json"]},
        {"outputs": {"a\0.json": ""}},
        {"row": [1]},
        {"image": ["a.jpg"]},
        {"image": None},
    ],
)
def test_line_of_other_content_is_not_found(path: Path, change: dict[str, Any]) -> None:
    lines = path.read_text().splitlines()
    line = {key: value for key, value in (json.loads(lines[1]) | change).items() if value is not None}
    path.write_text(lines[0] + "\n" + json.dumps(line) + "\n")
    assert found(path) is None


@pytest.mark.parametrize("text", ['{"target": "a"}', '{"target": ["a"], "sha256": "b"}', "[" * 99999])
def test_line_without_its_keys_is_dropped(path: Path, text: str) -> None:
    with path.open("a") as file:
        file.write(text + "\n")
    manifest = Manifest(path, SETTINGS, resume=True)
    assert manifest.cut_off and manifest.find(JOB, path.parent) is not None
