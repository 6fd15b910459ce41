"""``--csv`` and ``blur2view triage``: what the table holds, which photographs the list names."""

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from blur2view import output_files
from blur2view.cli import commands as cli
from blur2view.cli.triage import list_text, use_of
from blur2view.errors import OutputError, RunError
from blur2view.file_writing import write_atomically
from blur2view.photographs.image import read_image
from blur2view.results.table import Row, table_text
from blur2view.runs.manifest import Manifest
from blur2view.smears.sharpness import median_smear
from tests.support.colour_code import colour_code, forward_motion, write_picture
from tests.support.grids import grid_of
from tests.support.many_photographs import contents

COLUMNS = [
    "name", "verdict", "parallax", "smear_px", "smear_percent", "direction_deg", "sharpness", "rotation_deg",
    "frame", "timestamp_s", "wx", "wy", "wz", "sigma_wx", "sigma_wy", "sigma_wz", "rate_unit",
    "time_confidence", "inliers", "elapsed_s", "use", "error", "meaning",
]  # fmt: skip


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    """Return a folder of photographs: one still, one blurred by forward motion, one without any order."""
    folder = tmp_path / "frames"
    (folder / "left").mkdir(parents=True)
    texture = 1 + 0.5 * (np.indices((64, 80)) // 8 % 2).sum(axis=0)  # in sigma; what has none has no smear
    write_picture(folder / "still.png", colour_code(np.zeros((64, 80, 2)), texture))
    write_picture(folder / "left" / "moving.png", colour_code(forward_motion(), 1.0))
    rng = np.random.default_rng(0)
    cells = rng.normal(0, 12, (15, 20, 2))
    chaos = np.repeat(np.repeat(cells, 32, 0), 32, 1)
    write_picture(folder / "chaos.png", colour_code(chaos, 1.0))
    return folder


def call(command: str, tiny_model: Path, *words: object) -> int:
    return cli.main([command, "--model", str(tiny_model), "--jobs", "1", *map(str, words)])


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        reader = csv.DictReader(file)
        rows = list(reader)
    assert reader.fieldnames == COLUMNS
    return rows


def test_table_and_list_of_a_folder(
    frames: Path, tiny_model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sheet, keep = tmp_path / "deep" / "t.csv", tmp_path / "other" / "keep.txt"
    words = (frames, "--recursive", "--csv", sheet, "--keep", keep)
    assert call("triage", tiny_model, *words) == 0
    rows = {one["name"]: one for one in table(sheet)}
    assert list(rows) == ["chaos.png", "left/moving.png", "still.png"]  # as COLMAP names them below frames
    assert [one["use"] for one in rows.values()] == ["unusable", "blurred", "sharp"]
    assert keep.read_text() == "still.png\n"
    assert rows["still.png"]["verdict"] == "DEGENERATE" and float(rows["still.png"]["sharpness"]) > 0.9
    moving = rows["left/moving.png"]
    length = np.median(np.linalg.norm(forward_motion(), axis=-1))
    assert float(moving["smear_px"]) == pytest.approx(length, rel=0.1)
    assert float(moving["sharpness"]) == pytest.approx(1 / (1 + length), rel=0.1)
    assert moving["verdict"] == "UNCALIBRATED" and moving["parallax"] == "proven"
    assert moving["rotation_deg"] == moving["wx"] == "" and float(moving["elapsed_s"]) > 0
    printed = capsys.readouterr().out
    assert "1 sharp, 1 blurred but of use, 1 unusable" in printed
    assert f"left/moving.png: median of all smears {float(moving['smear_px']):.3g} px" in printed
    assert call("triage", tiny_model, *words, "--blurred") == 0
    assert keep.read_text() == "left/moving.png\nstill.png\n"
    assert call("triage", tiny_model, *words, "--max-smear", 100) == 0
    assert keep.read_text() == "chaos.png\nleft/moving.png\nstill.png\n"


def test_photographs_that_fail_are_counted_too(
    frames: Path, tiny_model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = (frames / "still.png", frames / "none.png", "--csv", tmp_path / "t.csv")
    assert call("triage", tiny_model, *words) == 1
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("2 photographs: 1 sharp, 0 blurred but of use, 0 unusable, 1 failed; wrote ")


def test_lines_say_the_use_and_an_empty_list_what_would_fill_it(
    frames: Path, tiny_model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("triage", tiny_model, frames, "--recursive", "--keep", tmp_path / "all.txt") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.rpartition("; ")[2] for line in lines[:3]] == ["unusable", "blurred", "sharp"]
    assert "nothing is kept" not in lines[-1]
    assert call("triage", tiny_model, frames / "left" / "moving.png", "--keep", tmp_path / "one.txt") == 0
    printed = capsys.readouterr().out.splitlines()
    assert (
        printed[-1]
        == "nothing is kept: --blurred keeps the blurred ones that are of use, --best 50% the sharper half"
    )
    assert call("triage", tiny_model, frames / "chaos.png", "--keep", tmp_path / "other.txt") == 0
    told = capsys.readouterr().out.splitlines()[-1]
    assert told.startswith("nothing is kept: the sharpest has a median of ") and told.endswith("is 3")
    (tmp_path / "none.png").write_bytes(b"no picture")
    assert call("triage", tiny_model, tmp_path / "none.png", "--keep", tmp_path / "none.txt") == 1
    assert "no photograph shows texture" not in capsys.readouterr().out


def test_a_list_in_the_folder_names_its_photographs_from_anywhere(
    frames: Path,
    tiny_model: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    keep = frames / "keep.txt"
    assert call("triage", tiny_model, frames, "--recursive", "--keep", keep, "--blurred") == 0
    assert keep.read_text() == "left/moving.png\nstill.png\n"  # as COLMAP has them
    monkeypatch.chdir(tmp_path)
    assert call("triage", tiny_model, "@frames/keep.txt", "--csv", "t.csv") == 0
    assert [one["name"] for one in table(tmp_path / "t.csv")] == ["left/moving.png", "still.png"]
    shutil.copy(frames / "still.png", tmp_path / "still.png")  # which one the list means is not known
    assert call("triage", tiny_model, "@frames/keep.txt", "--csv", "u.csv") == 1
    assert "still.png is here and beside the list" in capsys.readouterr().err


def test_photographs_that_fail_have_a_row_and_are_not_listed(
    frames: Path, tiny_model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (frames / "broken.png").write_bytes(b"no picture")
    sheet, keep = tmp_path / "t.csv", tmp_path / "keep.txt"
    assert call("triage", tiny_model, frames, "--csv", sheet, "--keep", keep) == 1
    (broken,) = (one for one in table(sheet) if one["name"] == "broken.png")
    assert "broken.png" in broken["error"] and broken["use"] == broken["verdict"] == ""
    assert "broken.png" not in keep.read_text()
    assert capsys.readouterr().err.count("\n") == 1


def test_resumed_run_has_every_row_and_judges_anew(frames: Path, tiny_model: Path, tmp_path: Path) -> None:
    sheet, keep = tmp_path / "t.csv", tmp_path / "keep.txt"
    words = (frames, "--recursive", "--csv", sheet, "--keep", keep)
    assert call("triage", tiny_model, *words) == 0
    before = sheet.read_bytes()
    assert call("triage", tiny_model, *words, "--resume") == 0
    assert sheet.read_bytes() == before  # the times, too: nothing was done again
    assert call("triage", tiny_model, *words, "--resume", "--max-smear", 100) == 0
    assert [one["use"] for one in table(sheet)] == ["sharp"] * 3
    assert [one["elapsed_s"] for one in table(sheet)] == [
        one["elapsed_s"] for one in csv.DictReader(before.decode().splitlines())
    ]


@pytest.mark.parametrize("words", [["--csv", "frames/still.png"], ["--keep", "frames/still.png"]])
def test_no_photograph_is_replaced_by_a_table_or_a_list(
    frames: Path, tiny_model: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    monkeypatch.chdir(frames.parent)
    before = (frames / "still.png").read_bytes()
    for more in ([], ["--overwrite"]):
        assert call("triage", tiny_model, "frames", *words, *more) == 1
    assert (frames / "still.png").read_bytes() == before


def test_files_of_others_are_spared(
    frames: Path, tiny_model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sheet, keep = tmp_path / "t.csv", tmp_path / "keep.txt"
    sheet.write_text("a,b\n")
    keep.write_text("still.png\nsomething else\n")
    assert call("triage", tiny_model, frames, "--csv", sheet, "--overwrite") == 1
    assert call("triage", tiny_model, frames, "--keep", keep, "--overwrite") == 1
    assert sheet.read_text() == "a,b\n" and "something else" in keep.read_text()
    assert capsys.readouterr().err.count("of an earlier call") == 2
    assert call("triage", tiny_model, frames, "--csv", tmp_path / "one", "--keep", tmp_path / "one") == 1
    assert call("report", tiny_model, frames, "-o", tmp_path / "two", "--csv", tmp_path / "two") == 1
    assert capsys.readouterr().err.count("two results would be one file") == 2
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_file()) == ["keep.txt", "t.csv"]


@pytest.mark.parametrize(
    "words",
    [
        ["estimate", "-o", "o2", "--csv", "o2/chaos.json"],
        ["segment", "-o", "o2", "--csv", "o2/still.motion.json"],
        ["estimate", "--csv", "o2/estimate.manifest.jsonl", "-o", "o2"],
        ["triage", "--csv", "t.csv", "--keep", "t.csv.manifest.jsonl"],
        ["report", "-o", "a.html", "--csv", "a.html.manifest.jsonl"],
    ],
)
def test_table_and_list_replace_no_result_and_no_manifest_of_their_call(
    frames: Path, tiny_model: Path, monkeypatch: pytest.MonkeyPatch, words: list[str],
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(frames.parent)
    assert call(words[0], tiny_model, "frames", *words[1:]) == 1
    assert "two results would be one file" in capsys.readouterr().err
    assert [path.name for path in frames.parent.iterdir() if path.is_file()] == []


@pytest.mark.parametrize("option", ["--keep", "--csv"])
def test_list_of_the_photographs_is_not_replaced(
    frames: Path, tiny_model: Path, monkeypatch: pytest.MonkeyPatch, option: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(frames)
    Path("all.txt").write_text("chaos.png\nstill.png\n")
    assert call("triage", tiny_model, "@all.txt", option, "all.txt", "--overwrite") == 1
    assert Path("all.txt").read_text() == "chaos.png\nstill.png\n"
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize("again", [["--resume"], ["--overwrite"], []])
def test_list_is_ours_after_a_photograph_was_deleted(
    frames: Path, tiny_model: Path, tmp_path: Path, again: list[str]
) -> None:
    words = (frames, "--recursive", "--keep", tmp_path / "keep.txt")
    assert call("triage", tiny_model, *words) == 0
    assert (tmp_path / "keep.txt").read_text() == "still.png\n"
    (frames / "still.png").unlink()
    assert call("triage", tiny_model, *words, *again) == 0
    assert (tmp_path / "keep.txt").read_text() == ""
    (tmp_path / "keep.txt").write_text("mine.png\n")
    assert call("triage", tiny_model, *words, *again) == 1
    assert (tmp_path / "keep.txt").read_text() == "mine.png\n"


def test_without_a_table_and_a_list_each_photograph_has_its_line(
    frames: Path, tiny_model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("triage", tiny_model, frames / "still.png") == 0
    line, total = capsys.readouterr().out.splitlines()
    assert "still.png: median of all smears" in line and total.startswith("1 photograph: 1 sharp")
    assert not list(frames.glob("*.csv*"))


@pytest.mark.parametrize(
    "words",
    [
        ["--resume"],
        ["--csv", "t.csv", "--max-smear", "-1"],
        ["--keep", "k", "--max-smear", "nan%"],
        ["--keep", "k", "--best", "0"],
        ["--keep", "k", "--best", "1.5"],
        ["--keep", "k", "--best", "101%"],
        ["--keep", "k", "--best", "5", "--every-best", "2"],
        ["--csv", "t.csv", "--every-best", "2"],
    ],
)
def test_wrong_usage_is_exit_code_2(frames: Path, tiny_model: Path, words: list[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        call("triage", tiny_model, frames, *words)
    assert caught.value.code == 2


@pytest.mark.parametrize("command", ["estimate", "segment", "report", "to-colmap"])
def test_every_command_writes_the_same_rows(
    command: str, moving: Path, still: Path, tiny_model: Path, tmp_path: Path
) -> None:
    target = {"report": ["-o", tmp_path / "a.html"], "to-colmap": ["--db", tmp_path / "a.db"]}
    sheets = tmp_path / "triage.csv", tmp_path / "own.csv"
    camera = ("--focal", 300)
    assert call("triage", tiny_model, moving, still, *camera, "--csv", sheets[0]) == 0
    assert (
        call(command, tiny_model, moving, still, *camera, "--csv", sheets[1], *target.get(command, [])) == 0
    )
    first, second = map(table, sheets)
    for ours, own in zip(first, second, strict=True):
        assert {key: own[key] for key in COLUMNS[:10]} == {key: ours[key] for key in COLUMNS[:10]}
        assert own["use"] == ""
    assert float(first[0]["rotation_deg"]) >= 0


def test_angular_velocity_is_the_rotation_over_the_exposure(
    moving: Path, tiny_model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sheet = tmp_path / "t.csv"
    words = (moving, "--focal", 300, "--exposure", 0.02, "--csv", sheet, "--json", "--no-timings")
    assert call("estimate", tiny_model, *words) == 0
    facts = json.loads(capsys.readouterr().out)["estimates"][0]
    (one,) = table(sheet)
    for axis in ("wx", "wy", "wz", "sigma_wx", "sigma_wy", "sigma_wz"):
        assert float(one[axis]) == pytest.approx(facts[axis], rel=1e-5)
    assert one["rate_unit"] == facts["rate_unit"] == "rad/s" and one["frame"] == one["timestamp_s"] == ""
    assert float(one["rotation_deg"]) == pytest.approx(facts["rotation_deg"], rel=1e-5)
    assert int(one["inliers"]) == facts["num_inliers"] and one["elapsed_s"] == ""
    written = sheet.read_bytes()
    assert call("estimate", tiny_model, *words, "--overwrite") == 0
    assert sheet.read_bytes() == written


def test_use_follows_smear_and_geometry() -> None:
    def use(smear_px: float | None, verdict: str, error: str = "", before: str = "") -> str:
        return use_of(Row(name="a", verdict=verdict, error=error), smear_px, 3.0, before)

    assert use(3.0, "DEGENERATE") == "sharp"
    assert use(3.1, "DEGENERATE") == use(30, "UNDEFINED") == use(None, "DEGENERATE") == "unusable"
    assert {use(30, verdict) for verdict in ("UNCALIBRATED", "PLANAR", "PANORAMIC", "MULTIPLE")} == {
        "blurred"
    }
    assert use(None, "", "broken") == ""
    for near in (2.95, 3.05, 3.2):  # as the one before
        assert (
            use(near, "PLANAR", before="sharp") == "sharp"
            and use(near, "PLANAR", before="blurred") == "blurred"
        )
    assert use(2.7, "PLANAR", before="blurred") == "sharp" and use(3.4, "PLANAR", before="sharp") == "blurred"


def test_list_leaves_out_a_name_with_a_line_break(capsys: pytest.CaptureFixture[str]) -> None:
    assert list_text(["a.png", "b\nc.png", "d e.png"]) == "a.png\nd e.png\n"
    assert "b\\nc.png: has a line break" in capsys.readouterr().err


def test_names_with_commas_and_lines_stay_one_cell() -> None:
    odd = 'a,"b"\nc.png'
    text = table_text([Row(name=odd, error="x"), Row(name="b.png", smear_px=1 / 3)])
    rows = list(csv.DictReader(text.splitlines(keepends=True)))
    assert [one["name"] for one in rows] == [odd, "b.png"] and rows[1]["smear_px"] == "0.333333"


def test_median_smear_has_one_direction_whatever_the_signs() -> None:
    rng = np.random.default_rng(0)
    signs = rng.choice([-1.0, 1.0], (40, 60, 1))
    for angle in (1.0, 90.0, 179.0):
        phi = np.radians(angle)
        found = median_smear(grid_of(signs * 7 * np.array([np.cos(phi), np.sin(phi)]), 1.0))
        assert found is not None and found.length_px == pytest.approx(7, rel=1e-4)
        assert found.direction_deg == pytest.approx(angle, abs=1e-3) and found.sharpness == pytest.approx(
            1 / 8
        )


def test_what_shows_no_texture_has_no_say() -> None:
    displacement, sigma = np.zeros((64, 64, 2)), np.full((64, 64), 1000.0)
    assert median_smear(grid_of(displacement, sigma)) is None
    displacement[:, :16], sigma[:, :16] = (9.0, 0.0), 2.0
    found = median_smear(grid_of(displacement, sigma))
    assert found is not None and found.length_px == pytest.approx(9)


def test_refused_table_leaves_no_folder(frames: Path, tiny_model: Path, tmp_path: Path) -> None:
    (tmp_path / "there.csv").write_text("a,b\n")
    (tmp_path / "file").touch()
    words = ("estimate", tiny_model, frames / "still.png")
    assert call(*words, "-o", tmp_path / "new", "--csv", tmp_path / "there.csv") == 1
    assert call(*words, "-o", tmp_path / "file" / "new", "--csv", tmp_path / "sheets" / "t.csv") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "frames", "there.csv"]


@pytest.mark.parametrize(
    ("command", "words"),
    [("report", ["-o", "a.html"]), ("triage", ["--keep", "a.html"]), ("to-colmap", ["--db", "a.html"])],
)
def test_table_that_cannot_be_written_costs_no_other_result(
    frames: Path, tiny_model: Path, tmp_path: Path, command: str, words: list[str],
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def full(path: Path, write: Any) -> None:
        if path.suffix == ".csv":
            raise OSError(28, "No space left on device")
        write_atomically(path, write)

    monkeypatch.setattr(output_files, "write_atomically", full)
    words = [word.replace("a.html", str(tmp_path / "a.html")) for word in words]
    assert call(command, tiny_model, frames, *words, "--csv", tmp_path / "t.csv") == 1
    printed = capsys.readouterr()
    assert len(printed.err.splitlines()) == 1 and "No space left on device" in printed.err
    assert (tmp_path / "a.html").exists() and "t.csv" not in printed.out


@pytest.mark.parametrize("error", [RunError("the cluster is gone"), OutputError("the manifest is full")])
def test_run_that_cannot_go_on_keeps_what_an_earlier_one_made_of_all(
    frames: Path,
    tiny_model: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: Exception,
) -> None:
    sheet, keep = tmp_path / "t.csv", tmp_path / "k.txt"
    made = {"triage": keep, "report": tmp_path / "a.html", "to-colmap": tmp_path / "a.db"}
    words = {
        "triage": ("--csv", sheet, "--keep", keep),
        "report": ("-o", made["report"]),
        "to-colmap": ("--db", made["to-colmap"]),
    }
    for command, target in made.items():
        assert call(command, tiny_model, frames, *words[command]) == 0 and target.exists()
    before = {command: target.read_bytes() for command, target in made.items()}
    shutil.copy(frames / "still.png", frames / "another.png")
    capsys.readouterr()

    def fail(manifest: Manifest, line: Any) -> None:
        raise error

    with monkeypatch.context() as patched:
        patched.setattr(Manifest, "_write", fail)
        for command, target in made.items():
            assert call(command, tiny_model, frames, *words[command], "--resume") == 1
            assert target.read_bytes() == before[command]
            assert capsys.readouterr().err == f"blur2view: {error}\n"
    for command, target in made.items():
        assert call(command, tiny_model, frames, *words[command], "--resume") == 0
        assert target.read_bytes() != before[command]


def test_what_was_done_before_the_run_could_not_go_on_is_printed(
    frames: Path,
    tiny_model: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    append = Manifest.append

    def fail(manifest: Manifest, job: Any, *rest: Any) -> None:
        if job.index == 1:
            raise RunError("the cluster is gone")
        append(manifest, job, *rest)

    monkeypatch.setattr(Manifest, "append", fail)
    assert call("triage", tiny_model, frames, "--csv", tmp_path / "t.csv") == 1
    assert [one["name"] for one in table(tmp_path / "t.csv")] == ["chaos.png"]
    capsys.readouterr()
    assert call("estimate", tiny_model, frames, "-o", tmp_path / "out", "--json") == 1
    assert len(json.loads(capsys.readouterr().out)["estimates"]) == 1


def test_table_and_page_of_any_name_are_replaced_if_asked(
    frames: Path, tiny_model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    odd = ["tab.json", "tab.html", "tab", "tab.png"]
    for name in odd:
        for more in ([], ["--overwrite"], ["--resume"]):
            assert call("triage", tiny_model, frames, "--csv", tmp_path / name, *more) == 0
    for name in ("page.csv", "page.npz", "page"):
        for more in ([], ["--overwrite"], ["--resume"]):
            words = (frames / "still.png", "--no-mask", "-o", tmp_path / name, *more)
            assert call("report", tiny_model, *words) == 0
    capsys.readouterr()
    # of another kind
    before = (tmp_path / "page.csv").read_bytes()
    assert call("triage", tiny_model, frames, "--csv", tmp_path / "page.csv", "--overwrite") == 1
    assert "is no table of an earlier call" in capsys.readouterr().err
    assert (tmp_path / "page.csv").read_bytes() == before


def write_clip(path: Path, count: int) -> Path:
    """Return a video of one scene, the camera moved a little from frame to frame."""
    rng = np.random.default_rng(0)
    scene = cv2.resize(rng.integers(0, 255, (12, 24, 3), dtype=np.uint8), None, fx=10, fy=10)
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10, (160, 96))
    for index in range(count):
        video.write(scene[:96, index : index + 160])
    video.release()
    return path


def test_frames_of_a_video_are_extracted_under_their_numbers_and_judged_alike(
    tiny_model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip, folder = write_clip(tmp_path / "clip.mp4", 7), tmp_path / "clip"
    whole = ("--best", "100%", "--extract", folder, "--csv", tmp_path / "video.csv")
    assert call("triage", tiny_model, clip, *whole, "--no-timings") == 0
    assert sorted(path.name for path in folder.iterdir()) == [f"frame_{k:05d}.png" for k in range(7)]
    assert f"7 kept; wrote {tmp_path / 'video.csv'} and {folder}" in capsys.readouterr().out
    for number in range(7):  # the pixels themselves
        np.testing.assert_array_equal(
            read_image(folder / f"frame_{number:05d}.png"), read_image(clip / f"{number:06d}")
        )
    assert call("triage", tiny_model, folder, "--csv", tmp_path / "frames.csv", "--no-timings") == 0
    video, frames = table(tmp_path / "video.csv"), table(tmp_path / "frames.csv")
    place = dict.fromkeys(("name", "frame", "timestamp_s"), "")
    assert [one | place for one in video] == [one | place for one in frames]


def test_extracted_are_the_best_of_every_few_and_nothing_is_replaced(
    tiny_model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip, folder, keep = write_clip(tmp_path / "clip.mp4", 8), tmp_path / "deep" / "kept", tmp_path / "k.txt"
    words = (clip, "--every-best", 4, "--extract", folder)
    assert call("triage", tiny_model, *words, "--keep", keep) == 0
    names = sorted(path.name for path in folder.iterdir())
    assert keep.read_text().splitlines() == [f"clip.mp4/0{name[6:11]}" for name in names]
    first, second = (int(name[6:11]) for name in names)
    assert 0 <= first < 4 <= second < 8
    before = contents(folder)
    assert call("triage", tiny_model, *words) == 0 and contents(folder) == before
    capsys.readouterr()
    for others in (("--best", 1), ("--best", 3)):  # fewer; others
        assert call("triage", tiny_model, clip, *others, "--extract", folder) == 1
        assert "with --extract" in capsys.readouterr().err and contents(folder) == before
    (folder / names[0]).write_bytes(b"mine")
    assert call("triage", tiny_model, *words) == 1
    assert f"{names[0]}: is there with another content" in capsys.readouterr().err
    assert (folder / names[0]).read_bytes() == b"mine"
    (folder / "mine.txt").touch()
    assert call("triage", tiny_model, *words) == 1
    assert (
        capsys.readouterr().err
        == f"blur2view: {folder}: holds mine.txt; name an empty folder with --extract\n"
    )


def test_photographs_are_copied_and_frames_of_several_videos_kept_apart(
    frames: Path, tiny_model: Path, tmp_path: Path
) -> None:
    clips = [write_clip(tmp_path / name, 2) for name in ("a.mp4", "b.mp4")]
    folder = tmp_path / "all"
    words = (*clips, frames, "--recursive", "--best", "100%", "--extract", folder)
    assert call("triage", tiny_model, *words) == 0
    below = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    pictures = {"frames/still.png", "frames/chaos.png", "frames/left/moving.png"}
    assert below == pictures | {f"{clip}.mp4/frame_0000{k}.png" for clip in "ab" for k in (0, 1)}
    assert (folder / "frames/still.png").read_bytes() == (frames / "still.png").read_bytes()


def test_one_photograph_is_told_without_any_file(
    frames: Path, tiny_model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("triage", tiny_model, frames / "still.png") == 0
    first, last = capsys.readouterr().out.splitlines()
    assert first.endswith("; sharp") and last.startswith("1 photograph: 1 sharp") and "wrote" not in last


def test_limit_in_per_cent_follows_the_size(frames: Path, tiny_model: Path, tmp_path: Path) -> None:
    sheet = tmp_path / "t.csv"
    moving = frames / "left" / "moving.png"
    assert call("triage", tiny_model, moving, "--csv", sheet) == 0
    (one,) = table(sheet)
    height, width = read_image(moving).shape[:2]
    assert float(one["smear_percent"]) == pytest.approx(
        100 * float(one["smear_px"]) / np.hypot(width, height), rel=1e-5
    )
    for factor, use in ((1.01, "sharp"), (0.99, "blurred")):
        limit = f"{factor * float(one['smear_percent'])}%"
        assert call("triage", tiny_model, moving, "--csv", sheet, "--overwrite", "--max-smear", limit) == 0
        assert table(sheet)[0]["use"] == use


def test_a_run_that_is_ended_early_extracts_nothing_and_keeps_an_earlier_choice(
    frames: Path, tiny_model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    keep, folder = tmp_path / "keep.txt", tmp_path / "chosen"
    words = ["--best", "1", "--keep", keep, "--extract", folder]
    assert call("triage", tiny_model, frames, *words) == 0
    whole = keep.read_text()
    (frames / "0.png").write_bytes(b"no picture")
    assert call("triage", tiny_model, frames, tmp_path / "none.png", *words, "--max-failures", "1") == 1
    assert keep.read_text() == whole
    assert str(folder) not in capsys.readouterr().out.splitlines()[-1]
