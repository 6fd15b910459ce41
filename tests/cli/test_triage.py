"""``blur2view triage``: what it says of photographs, and which of them the list names."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from blur2view.cli.triage import Sharp
from blur2view.results.photograph import Photograph
from tests.support.calls import Call
from tests.support.colour_code import forward_motion
from tests.support.tables import table


@pytest.mark.slow
def test_table_and_list_of_a_folder(frames: Path, call: Call, tmp_path: Path) -> None:
    sheet, keep = tmp_path / "deep" / "t.csv", tmp_path / "other" / "keep.txt"
    words = (frames, "--recursive", "--csv", sheet, "--keep", keep)
    done = call("triage", *words)
    rows = {one["name"]: one for one in table(sheet)}
    assert list(rows) == ["chaos.png", "left/moving.png", "still.png"]  # as COLMAP names them below frames
    assert [one["use"] for one in rows.values()] == ["unusable", "blurred", "sharp"]
    assert keep.read_text() == "still.png\n"
    assert rows["still.png"]["config"] == "DEGENERATE" and float(rows["still.png"]["sharpness"]) > 0.3
    assert rows["still.png"]["blur"] == "sharp" and rows["still.png"]["verdict"].startswith("Sharp")
    moving = rows["left/moving.png"]
    length = np.median(np.linalg.norm(forward_motion(), axis=-1))
    assert float(moving["smear_px"]) == pytest.approx(length, rel=0.15)
    assert float(moving["sharpness"]) == pytest.approx(1 / (1 + float(moving["width_px"])), rel=1e-3)
    assert moving["config"] == "PLANAR" and moving["parallax"] == "undecided"  # of so few cells
    assert moving["rotation_deg"] == moving["wx"] == "" and float(moving["elapsed_s"]) > 0
    assert done == 0 and "1 sharp, 1 blurred but of use, 1 unusable" in done.out
    assert f"left/moving.png: blurred (smears of {float(moving['smear_px']):.0f} px)" in done.out
    assert call("triage", *words, "--blurred") == 0
    assert keep.read_text() == "left/moving.png\nstill.png\n"
    assert call("triage", *words, "--max-smear", 100) == 0
    assert keep.read_text() == "chaos.png\nleft/moving.png\nstill.png\n"
    poses, training = tmp_path / "poses.txt", tmp_path / "train.txt"
    lists = ("--keep-for-poses", poses, "--keep-for-training", training)
    done = call("triage", frames, "--recursive", "--gsd", "2cm", "--csv", sheet, *lists)
    for row in table(sheet):
        assert float(row["smear_ground_m"]) == pytest.approx(0.02 * float(row["smear_px"]), rel=1e-4)
    assert (poses.read_text(), training.read_text()) == ("left/moving.png\nstill.png\n", "still.png\n")
    assert "cm on the ground" in done.out and f"wrote {sheet} and {poses} and {training}" in done.out


def test_a_list_in_the_folder_names_its_photographs_from_anywhere(
    frames: Path, call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep = frames / "keep.txt"
    assert call("triage", frames, "--recursive", "--keep", keep, "--blurred") == 0
    assert keep.read_text() == "left/moving.png\nstill.png\n"  # as COLMAP has them
    monkeypatch.chdir(tmp_path)
    assert call("triage", "@frames/keep.txt", "--csv", "t.csv") == 0
    assert [one["name"] for one in table(tmp_path / "t.csv")] == ["left/moving.png", "still.png"]
    shutil.copy(frames / "still.png", tmp_path / "still.png")  # which one the list means is not known
    done = call("triage", "@frames/keep.txt", "--csv", "u.csv")
    assert done == 1 and "still.png is here and beside the list" in done.err


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
    assert last.startswith("3 photographs in ")
    assert "1 sharp, 0 blurred but of use, 1 unusable, 1 failed; " in last


@pytest.mark.parametrize(
    ("names", "numbers", "in_order", "last"),
    [
        (("a/01.png", "a/02.png"), (None, None), False, "blurred"),
        (("a/01.png", "a/02.png"), (None, None), True, "sharp"),
        (("v.mp4/000004", "v.mp4/000005"), (4, 5), False, "sharp"),
        (("v.mp4/000004", "v.mp4/000006"), (4, 6), False, "blurred"),
    ],
)
def test_near_the_limit_a_frame_follows_the_one_before_and_no_other_photograph_does(
    names: tuple[str, str], numbers: tuple[int | None, int | None], in_order: bool, last: str
) -> None:
    classify = Sharp(in_order=in_order).classifier()
    eye = np.eye(3).tolist()
    uses = [
        classify(
            Photograph(
                name=name, frame=frame, blur="camera moved", H=eye, smear_px=smear_px, smear_sigma_px=0.1
            )
        ).use
        for name, frame, smear_px in zip(names, numbers, (2.0, 3.1), strict=True)
    ]
    assert uses == ["sharp", last]


def test_what_no_list_holds_is_not_counted_as_kept(frames: Path, call: Call, tmp_path: Path) -> None:
    for name in ("a\nb.png", "c d.png"):
        shutil.copy(frames / "still.png", frames / name)
    done = call("triage", frames, "--keep", tmp_path / "keep.txt")
    assert done == 1 and "a\\nb.png: has a line break" in done.line
    assert (tmp_path / "keep.txt").read_text() == "c d.png\nstill.png\n"
    assert "; 2 kept; wrote" in done.out


def test_no_name_in_a_table_is_a_formula(frames: Path, call: Call, here: Path) -> None:
    for name in ("=1+1.png", "@SUM.png", "-2.png"):
        shutil.copy(frames / "still.png", frames / name)
    assert call("triage", frames, "--csv", "t.csv") == 0
    names = [row["name"] for row in table(Path("t.csv"))]
    assert {"./=1+1.png", "./@SUM.png", "./-2.png"} < set(names) and "still.png" in names


@pytest.mark.slow
def test_lines_say_the_use_and_an_empty_list_what_would_fill_it(
    frames: Path, call: Call, tmp_path: Path
) -> None:
    lines = call("triage", frames, "--recursive", "--keep", tmp_path / "all.txt").out.splitlines()
    uses = [line.rpartition(": ")[2].partition(" ")[0] for line in lines[:3]]
    assert uses == ["unusable", "blurred", "sharp"]
    assert len(lines) == 4 and "1 kept" in lines[-1]  # one closing line
    last = call("triage", frames / "chaos.png", "--keep", tmp_path / "other.txt").out
    assert "none is kept: --max-smear is 3, --max-defocus 2; --blurred " in last
