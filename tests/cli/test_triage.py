"""``blur2view triage``: what it says of photographs, and which of them the list names."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.support.calls import Call, table
from tests.support.colour_code import forward_motion


@pytest.mark.slow
def test_table_and_list_of_a_folder(frames: Path, call: Call, tmp_path: Path) -> None:
    sheet, keep = tmp_path / "deep" / "t.csv", tmp_path / "other" / "keep.txt"
    words = (frames, "--recursive", "--csv", sheet)
    done = call("triage", *words, "--keep", keep)
    rows = {one["name"]: one for one in table(sheet)}
    assert list(rows) == ["chaos.png", "left/moving.png", "still.png"]  # as COLMAP names them below frames
    assert [one["use"] for one in rows.values()] == ["unusable", "blurred", "sharp"]
    assert keep.read_text() == "still.png\n"
    assert rows["still.png"]["config"] == ""
    assert rows["still.png"]["blur"] == "sharp" and rows["still.png"]["verdict"].startswith("Sharp")
    moving = rows["left/moving.png"]
    length = np.median(np.linalg.norm(forward_motion(), axis=-1))
    assert float(moving["smear_px"]) == pytest.approx(length, rel=0.15)
    assert moving["config"] == moving["parallax"] == moving["wx"] == ""  # it was looked at less closely
    assert done == 0 and "1 sharp, 1 blurred but of use, 1 unusable" in done.out
    assert f"left/moving.png: {moving['verdict']} [blurred]" in done.out
    last = call("triage", frames / "chaos.png", "--keep", tmp_path / "other.txt").out
    assert "none is kept: --max-smear is 3, --max-defocus 2; --blurred " in last
    for more, names in (
        (["--blurred"], "left/moving.png\nstill.png\n"),
        (["--max-smear", 100], "chaos.png\nleft/moving.png\nstill.png\n"),
    ):
        keep.unlink()
        assert call("triage", *words, "--keep", keep, *more) == 0 and keep.read_text() == names


def test_a_list_in_the_folder_names_its_photographs_from_anywhere(
    frames: Path, call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep = frames / "keep.txt"
    assert call("triage", frames, "--recursive", "--keep", keep, "--blurred") == 0
    assert keep.read_text() == "left/moving.png\nstill.png\n"  # as COLMAP has them
    monkeypatch.chdir(tmp_path)
    assert call("triage", "@frames/keep.txt", "--csv", "t.csv") == 0
    assert [one["name"] for one in table(tmp_path / "t.csv")] == ["left/moving.png", "still.png"]


def test_photographs_that_fail_have_a_row_are_counted_and_not_listed(
    frames: Path, call: Call, tmp_path: Path
) -> None:
    (frames / "broken.png").write_bytes(b"no picture")
    sheet, keep = tmp_path / "t.csv", tmp_path / "keep.txt"
    done = call("triage", frames, "--csv", sheet, "--keep", keep)
    (broken,) = (one for one in table(sheet) if one["name"] == "broken.png")
    assert "broken.png" in broken["error"] and broken["use"] == broken["config"] == ""
    assert "broken.png" not in keep.read_text()
    assert done == 1 and "broken.png" in done.line
    last = done.out.splitlines()[-1]
    assert last.startswith("3 photographs: 1 sharp, 1 unusable, 1 failed in ")


def test_no_name_in_a_table_is_a_formula(frames: Path, call: Call, here: Path) -> None:
    for name in ("=1+1.png", "@SUM.png", "-2.png"):
        shutil.copy(frames / "still.png", frames / name)
    assert call("triage", frames, "--csv", "t.csv") == 0
    names = [row["name"] for row in table(Path("t.csv"))]
    assert {"./=1+1.png", "./@SUM.png", "./-2.png"} < set(names) and "still.png" in names
