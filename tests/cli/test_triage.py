"""``blur2view triage``: what it says of photographs, and which of them are listed or extracted."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from blur2view.images.inputs import Inputs, Source
from blur2view.images.video import EndOfVideo, read_frame
from blur2view.networks.smear_network import SmearNetwork
from blur2view.records.record import LOOK, Record, explanations
from blur2view.results.triage import _records, triage
from tests.support.calls import Call, table
from tests.support.colour_code import forward_motion
from tests.support.many_photographs import contents, write_frames


def test_the_function_says_what_the_command_does(
    frames: Path, call: Call, tiny_model: Path, tmp_path: Path
) -> None:
    (frames / "damaged.png").write_bytes((frames / "still.png").read_bytes()[:40])
    shutil.move(frames / "still.png", frames / "1403636579.763.png")
    call("triage", frames, "--max-smear", 1e4, "--csv", tmp_path / "t.csv")
    found = list(triage(frames, max_smear_px=1e4, network=SmearNetwork(tiny_model)))
    columns = "name", "use", "verdict", "error", "timestamp_s"
    said = [[str(getattr(record, key) or "") for key in columns] for record in found]
    assert said == [[row[key] for key in columns] for row in table(tmp_path / "t.csv")]
    assert [bool(record.error) for record in found] == [False, False, True]
    unfilled = set(explanations(flat=True)) - set(LOOK)
    assert {key for key in unfilled for record in found if getattr(record, key)} == set()


@pytest.mark.parametrize(("whole", "errors"), [(True, ["", ""]), (False, ["", "", "ends after 2"])])
def test_the_function_gives_no_record_of_a_frame_that_was_never_recorded(
    whole: bool, errors: list[str]
) -> None:
    """A video that is cut off fails once."""

    def look(name: str, source: Source) -> Record:
        if (source.frame or 0) < 2:
            return Record(name=name)
        end = EndOfVideo("ends after 2")
        end.whole = whole
        raise end

    sources = [Source(path=Path("clip.mp4"), frame=number) for number in range(4)]
    assert [record.error for record in _records(look, Inputs(sources=sources))] == errors


@pytest.mark.slow
def test_table_and_list_of_a_folder(frames: Path, call: Call, tmp_path: Path) -> None:
    sheet, keep = tmp_path / "deep" / "t.csv", tmp_path / "other" / "keep.txt"
    words = (frames, "--recursive", "--csv", sheet)
    done = call("triage", *words, "--keep", keep)
    rows = {one["name"]: one for one in table(sheet)}
    assert list(rows) == ["chaos.png", "left/moving.png", "still.png"]  # as COLMAP names them below frames
    assert [one["use"] for one in rows.values()] == ["blurred", "blurred", "sharp"]
    assert keep.read_text() == "still.png\n"
    assert rows["still.png"]["blur"] == "sharp" and rows["still.png"]["verdict"].startswith("Sharp")
    moving = rows["left/moving.png"]
    length = np.median(np.linalg.norm(forward_motion(), axis=-1))
    assert float(moving["smear_px"]) == pytest.approx(length, rel=0.15)
    assert tuple(moving) == LOOK and "config" not in moving  # it was looked at less closely
    assert done == 0 and ": 1 sharp, 2 blurred (" in done.out
    assert f"left/moving.png: {moving['verdict']}\n" in done.out
    last = call("triage", frames / "chaos.png", "--keep", tmp_path / "other.txt").out
    assert "none is kept: --max-smear is 3, --max-defocus 2; --blurred " in last
    assert call("triage", *words, "--keep", keep, "--max-smear", 100) == 0
    everything = "chaos.png\nleft/moving.png\nstill.png\n"
    assert keep.read_text() == everything
    assert call("triage", *words, "--keep", keep, "--max-smear", "0.1%") == 0  # of 640 pixels
    assert keep.read_text() == "still.png\n"
    assert call("triage", *words, "--keep", keep, "--max-smear", "20%") == 0
    assert keep.read_text() == everything
    geometric = call("triage", *words, "--keep", keep, "--blurred")
    assert geometric == 0 and "1 sharp, 1 blurred but of use, 1 unusable" in geometric.out
    assert keep.read_text() == "left/moving.png\nstill.png\n"
    judged = {one["name"]: one for one in table(sheet)}
    assert judged["chaos.png"]["use"] == "unusable"
    place = dict.fromkeys(("use", "options_sha256"), "")
    assert [one | place for one in judged.values()] == [one | place for one in rows.values()]


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
    assert "broken.png" in broken["error"] and broken["use"] == broken["blur"] == ""
    assert "broken.png" not in keep.read_text()
    assert done == 1 and "broken.png" in done.line
    last = done.out.splitlines()[-1]
    assert last.startswith("3 photographs: 1 sharp, 1 blurred, 1 failed (")


def test_no_name_in_a_table_is_a_formula(frames: Path, call: Call, here: Path) -> None:
    for name in ("=1+1.png", "@SUM.png", "-2.png"):
        shutil.copy(frames / "still.png", frames / name)
    assert call("triage", frames, "--csv", "t.csv") == 0
    names = [row["name"] for row in table(Path("t.csv"))]
    assert {"./=1+1.png", "./@SUM.png", "./-2.png"} < set(names) and "still.png" in names


def write_clip(path: Path, count: int) -> Path:
    """Return a video of one scene, the camera moved a little from frame to frame."""
    rng = np.random.default_rng(0)
    scene = cv2.resize(rng.integers(0, 255, (12, 24, 3), dtype=np.uint8), None, fx=10, fy=10)
    return write_frames(path, [scene[:96, index : index + 160] for index in range(count)])


def test_frames_of_a_video_are_extracted_under_their_numbers_and_classified_alike(
    call: Call, tmp_path: Path
) -> None:
    clip, folder = write_clip(tmp_path / "clip.mp4", 7), tmp_path / "clip"
    whole = ("--best", 100, "--extract", folder, "--csv", tmp_path / "video.csv")
    done = call("triage", clip, *whole)
    assert sorted(path.name for path in folder.iterdir()) == [f"frame_{k:05d}.png" for k in range(7)]
    assert done == 0 and f"7 kept; wrote {tmp_path / 'video.csv'} and {folder}" in done.out
    for number in range(7):  # the pixels themselves
        np.testing.assert_array_equal(
            cv2.imread(str(folder / f"frame_{number:05d}.png")), read_frame(clip, number)
        )
    assert call("triage", folder, "--csv", tmp_path / "frames.csv") == 0
    video, frames = table(tmp_path / "video.csv"), table(tmp_path / "frames.csv")
    place = dict.fromkeys(("name", "frame", "timestamp_s", "input_sha256", "options_sha256"), "")
    assert [one | place for one in video] == [one | place for one in frames]


def test_extracted_are_the_best_of_every_few_and_nothing_of_others_is_replaced(
    call: Call, tmp_path: Path
) -> None:
    clip, folder, keep = write_clip(tmp_path / "clip.mp4", 8), tmp_path / "deep" / "kept", tmp_path / "k.txt"
    words = (clip, "--every-best", 4, "--extract", folder)
    assert call("triage", *words, "--keep", keep) == 0
    names = sorted(path.name for path in folder.iterdir())
    assert keep.read_text().splitlines() == [f"clip.mp4/0{name[6:11]}" for name in names]
    first, second = (int(name[6:11]) for name in names)
    assert 0 <= first < 4 <= second < 8
    before = contents(folder)
    assert call("triage", *words, "--keep", keep) == 0 and contents(folder) == before
    assert call("triage", clip, "--best", 1, "--extract", folder) == 0 and len(contents(folder)) == 1
    for name, why in (("mine.txt", "holds mine.txt"), (names[0], "differs from what this call would write")):
        (folder / name).write_text("mine")
        before = contents(folder)
        done = call("triage", *words)
        assert done == 1 and why in done.line and "name an empty folder with --extract" in done.line
        assert contents(folder) == before
        (folder / name).unlink()


def test_a_list_of_frames_says_that_colmap_needs_files_unless_they_are_written(
    call: Call, tmp_path: Path
) -> None:
    clip, keep = write_clip(tmp_path / "clip.mp4", 4), tmp_path / "k.txt"
    words = ("triage", clip, "--best", 1, "--keep", keep)
    assert "--extract DIR writes them as files" in call(*words).line
    assert call(*words, "--extract", tmp_path / "kept").err == call(*words, "-q").err == ""


def test_a_table_is_printed_and_a_list_lies_beside_where_pictures_go_into_the_current_folder(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip, folder = write_clip(tmp_path / "clip.mp4", 4), tmp_path / "kept"
    folder.mkdir()
    monkeypatch.chdir(folder)
    words = ("triage", clip, "--best", 1, "--extract", ".", "--csv", "-", "--keep", "../kept/../k.txt")
    assert call(*words) == 0
    assert (tmp_path / "k.txt").is_file() and len(contents(folder)) == 1


def test_of_a_video_without_the_frames_that_are_named_nothing_else_is_said(
    call: Call, tmp_path: Path
) -> None:
    done = call("triage", write_clip(tmp_path / "clip.mp4", 4), "--from", 9)
    assert done == 1 and "none from frame 9 on" in done.err and "no video is named" not in done.err


def test_options_that_choose_frames_are_named_where_there_is_no_video(
    call: Call, still: Path, tmp_path: Path
) -> None:
    done = call("triage", still, "--from", "9s", "--every", 2)
    assert done == 0 and "--every, --from: no video is named" in done.line
    assert call("triage", write_clip(tmp_path / "clip.mp4", 4), "--every", 2, "--to", 3).err == ""


def test_a_photograph_called_as_a_frame_replaces_none(call: Call, still: Path, tmp_path: Path) -> None:
    clip, folder = write_clip(tmp_path / "clip.mp4", 4), tmp_path / "kept"
    shutil.copy(still, photograph := tmp_path / "frame_00003.png")
    assert call("triage", clip, photograph, "--best", 9, "--extract", folder) == 0
    assert len(contents(folder)) == 5
    assert (folder / "frame_00003.png").read_bytes() == photograph.read_bytes()


def test_neighbours_are_those_of_a_folder_in_any_order_of_words(call: Call, still: Path, here: Path) -> None:
    for name in ("a/1.png", "b/1.png", "a/2.png", "b/2.png"):
        Path(name).parent.mkdir(exist_ok=True)
        shutil.copy(still, name)
    words = ("a/1.png", "b/1.png", "a/2.png", "b/2.png")
    assert call("triage", *words, "--every-best", 2, "--keep", "keep.txt") == 0
    assert Path("keep.txt").read_text() == "a/1.png\nb/1.png\n"


def test_a_list_names_what_it_was_written_of(call: Call, still: Path, here: Path) -> None:
    Path("in").mkdir()
    names = ["#1.png", "a.png ", " b.png", "c\x0b.png", "\u2028.png", "@d.png", "e.png"]
    for name in (*names, "line\nbreak.png"):
        shutil.copy(still, f"in/{name}")
    paths = [Path("in", name) for name in names]
    done = call("triage", *paths, "in/line\nbreak.png", "--keep", "in/keep.txt")
    assert done == 1 and "its name, which has a line break" in done.line
    assert call("triage", "@in/keep.txt", "--csv", "t.csv") == 0
    assert {row["name"].removeprefix("./") for row in table(Path("t.csv"))} == set(names)


def test_black_and_white_photographs_are_counted_as_such_and_are_the_last_to_keep(
    frames: Path, call: Call, tmp_path: Path
) -> None:
    noise = np.random.default_rng(0).normal(2.2, 1.9, (240, 320, 3))
    cv2.imwrite(str(frames / "cap.png"), np.clip(np.round(noise), 0, 255).astype(np.uint8))
    cv2.imwrite(str(frames / "white.png"), np.full((240, 320, 3), 255, np.uint8))
    sheet, keep = tmp_path / "t.csv", tmp_path / "keep.txt"
    done = call("triage", frames, "--csv", sheet, "--keep", keep, "--best", 2)
    rows = {one["name"]: one for one in table(sheet)}
    assert [rows[name]["nothing_seen"] for name in ("cap.png", "white.png")] == ["too dark", "overexposed"]
    assert rows["cap.png"]["use"] == "unclear" and "2 unclear (1 too dark, 1 overexposed)" in done.out
    assert keep.read_text().splitlines() == ["chaos.png", "still.png"]


def test_a_list_that_the_user_removed_is_written_anew(call: Call, still: Path, tmp_path: Path) -> None:
    keep = tmp_path / "keep.txt"
    assert call("triage", still, "--keep", keep) == 0
    keep.unlink()
    assert call("triage", still, "--keep", keep) == 0 and keep.read_text() == "still.png\n"
