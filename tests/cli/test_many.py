"""Folders, videos and lists: what is printed of many photographs, and what fails."""

import json
from pathlib import Path

import pytest

from tests.support.calls import Call, table
from tests.support.many_photographs import write_photographs, write_video


def test_folder_prints_one_line_each_and_a_total(run: Call, folder: Path, tmp_path: Path) -> None:
    printed = run(folder, tmp_path / "absent.png", "-o", tmp_path / "out")
    assert printed == 1 and len(printed.lines) == 1
    lines = printed.out.splitlines()
    assert [Path(line.partition(":")[0]).name for line in lines[:5]] == [f"{n:03d}.png" for n in range(5)]
    assert lines[5].startswith("6 photographs: 5 done, 1 failed (") and len(lines) == 6
    assert run(folder, "-q").out == ""


def test_subfolders_are_kept_in_the_output_and_results_are_no_photographs(run: Call, folder: Path) -> None:
    write_photographs(folder / "sub/deep", 1)
    out = folder / "out"  # inside the folder that is gone through
    for _ in range(2):
        done = run(folder, "--recursive", "--resume", "-o", out)
    assert done == 0 and "6 photographs: 6 done before" in done.out
    names = {path.relative_to(out).as_posix() for path in out.rglob("*.json")}
    assert names == {*(f"{n:03d}.json" for n in range(5)), "sub/deep/000.json"}


def test_frames_of_a_video_are_estimated_in_order(run: Call, tmp_path: Path) -> None:
    video, out = write_video(tmp_path / "clip.mp4", 25), tmp_path / "out"
    assert run(video, "--every", 10, "-o", out) == 0
    names = [path.relative_to(out).as_posix() for path in sorted(out.rglob("*.json"))]
    assert names == ["clip/000000.json", "clip/000010.json", "clip/000020.json"]
    document = json.loads((out / names[1]).read_text())
    assert document["name"] == "clip.mp4/000010" and document["timestamp_s"] == pytest.approx(1)
    done = run(video, "--from", "0.5s", "--to", 20, "--every", 5, "-o", out, "--resume")
    assert done == 0 and "4 frames: 2 done, 2 done before" in done.out


def test_without_a_rate_there_is_no_log_and_all_else_is_printed(run: Call, tmp_path: Path) -> None:
    video, log = write_video(tmp_path / "clip.mp4", 2), tmp_path / "clip.gcsv"
    done = run(video, "--focal", 300, "--gyroflow", log, "--json")
    assert done == 1 and "no frame is blurred enough for a rate" in done.line
    assert len(done.document["estimates"]) == 2 and not log.exists()
    other = write_video(tmp_path / "other.mp4", 2)
    done = run(video, other, "--focal", 300, "--gyroflow", log, "--json")
    assert done == 1 and "a log of rates holds one video" in done.line and done.out == ""


@pytest.mark.parametrize(
    "command", ["triage --keep keep.txt", "estimate -o out", "report --no-mask -o a.html"]
)
def test_folder_without_photographs_is_one_line_and_no_photograph(
    call: Call, folder: Path, here: Path, command: str
) -> None:
    (here / "empty").mkdir()
    name, *words = command.split()
    done = call(name, "empty", *words, "--csv", "new/t.csv")
    assert (done, done.out) == (1, "") and "empty: holds no photograph" in done.line
    assert {path.name for path in here.iterdir()} == {"in", "empty"}
    done = call(name, folder, "empty", *words, "--csv", "t.csv")
    assert done == 1 and "empty: holds no photograph" in done.line
    assert [row["name"] for row in table(here / "t.csv")] == [f"{n:03d}.png" for n in range(5)]
    if name == "report":
        assert (here / "a.html").read_text().count("<article ") == 5
