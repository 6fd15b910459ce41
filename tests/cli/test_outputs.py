"""``blur2view estimate -o``: what is replaced, refused or left alone."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blur2view import pipeline
from blur2view.cli import outputs as results
from tests.support.colour_code import colour_code, write_picture


def test_nothing_is_overwritten_without_being_asked(
    run: Any, moving: Path, still: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "moving.png").write_text("mine")
    assert run(moving, still, "-o", out) == 1
    assert "--overwrite" in capsys.readouterr().err
    assert sorted(path.name for path in out.iterdir()) == [
        "moving.png", "still.json", "still.png", "still.smear.npz"
    ]  # fmt: skip
    assert (out / "moving.png").read_text() == "mine"
    assert run(moving, "-o", out, "--overwrite") == 0
    assert (out / "moving.json").exists()


def test_full_disk_while_overwriting_keeps_the_old_results(
    run: Any, moving: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    assert run(moving, "-o", out) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}

    def full(text: str) -> bytes:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(results, "methodcaller", lambda name, content: full)  # from the second file on
    assert run(moving, "-o", out, "--overwrite", "--beta", "0.1") == 1
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_killed_while_overwriting_leaves_no_document_beside_new_arrays(
    run: Any, moving: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(moving, "-o", tmp_path / "out") == 0
    rename = Path.replace

    def killed(self: Path, target: Path) -> Path:
        if target.suffix == ".png":
            raise KeyboardInterrupt
        return rename(self, target)

    monkeypatch.setattr(Path, "replace", killed)
    assert run(moving, "-o", tmp_path / "out", "--overwrite") == 130
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["moving.png", "moving.smear.npz"]


def test_refusal_comes_before_the_work(
    run: Any, moving: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "moving.json").touch()
    monkeypatch.setattr(pipeline, "read_image", lambda path: pytest.fail("read in vain"))
    assert run(moving, "-o", tmp_path) == 1


def test_photograph_is_never_replaced_by_its_own_overlay(
    run: Any, moving: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = moving.read_bytes()
    assert run(moving, "-o", moving.parent, "--overwrite") == 1
    assert moving.read_bytes() == before
    assert "would replace the photograph" in capsys.readouterr().err


def test_second_photograph_of_the_same_name_is_refused(
    run: Any, still: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = write_picture(tmp_path / "still.tif", colour_code(np.zeros((48, 64, 2)), 1.0))
    assert run(still, other, "-o", tmp_path / "out", "--overwrite") == 1
    assert f"{other}: its results would replace those of {still}" in capsys.readouterr().err
    assert json.loads((tmp_path / "out" / "still.json").read_text())["image"] == str(still)


@pytest.mark.parametrize("below", ["", "deeper"])
def test_folder_that_cannot_be_written_is_one_line(
    run: Any, still: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], below: str
) -> None:
    (tmp_path / "file").touch()
    assert run(still, "-o", tmp_path / "file" / below) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "results cannot be written there" in line and "-o" in line


def test_full_disk_leaves_no_half_written_file(
    run: Any, still: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(file: Any, **arrays: object) -> None:
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    assert run(still, "-o", tmp_path / "out") == 1
    assert not (tmp_path / "out").exists()  # nothing succeeded, so nothing is left behind
    (line,) = capsys.readouterr().err.splitlines()
    assert "No space left on device" in line
