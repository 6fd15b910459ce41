"""Folders, videos and thousands: what is printed, skipped, done again and kept of a run that ends early."""

import json
import shutil
import signal
import sqlite3
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blur2view import pipeline
from blur2view.cli import commands as cli
from blur2view.errors import ImageError
from blur2view.file_writing import write_together
from blur2view.photographs.image import read_image
from blur2view.runs import job
from tests.support.colour_code import colour_code, write_picture
from tests.support.many_photographs import contents, finish, start, write_photographs, write_video

MANIFEST = "estimate.manifest.jsonl"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of five small photographs."""
    return write_photographs(tmp_path / "in", 5)[0].parent


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the names of the photographs that are read from now on."""
    names: list[str] = []

    def noted(path: Path, **options: Any) -> Any:
        names.append(Path(path).name)
        return read_image(path, **options)

    monkeypatch.setattr(pipeline, "read_image", noted)
    return names


def test_folder_prints_one_line_each_and_a_total(
    run: Any, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(folder, tmp_path / "absent.png", "-o", tmp_path / "out") == 1
    printed = capsys.readouterr()
    lines = printed.out.splitlines()
    assert [Path(line.partition(":")[0]).name for line in lines[:5]] == [f"{n:03d}.png" for n in range(5)]
    assert lines[5].startswith("6 photographs: 5 done, 1 failed in ") and len(lines) == 6
    assert len(printed.err.splitlines()) == 1
    assert run(folder, "-q") == 0 and capsys.readouterr().out == ""
    assert run(folder, "-v") == 0 and "s (read" in capsys.readouterr().out


def test_subfolders_are_kept_in_the_output_and_results_are_no_photographs(
    run: Any, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_photographs(folder / "sub/deep", 1)
    out = folder / "out"  # inside the folder that is gone through
    for _ in range(2):
        assert run(folder, "--recursive", "--resume", "-o", out) == 0
    assert "6 photographs: 6 done before" in capsys.readouterr().out
    names = {path.relative_to(out).as_posix() for path in out.rglob("*.json")}
    assert names == {*(f"{n:03d}.json" for n in range(5)), "sub/deep/000.json"}


def test_resume_does_only_what_is_new_changed_or_incomplete(
    run: Any, folder: Path, tmp_path: Path, read: list[str]
) -> None:
    out = tmp_path / "out"
    assert run(folder, "-o", out) == 0
    before = contents(out)
    read.clear()
    assert run(folder, "-o", out, "--resume") == 0
    assert read == [] and contents(out) == before

    (out / "000.png").unlink()
    (out / "001.json").write_bytes(before["001.json"][:-9])
    write_picture(folder / "002.png", colour_code(np.zeros((64, 80, 2)), 1.0))
    write_picture(folder / "900.png", colour_code(np.zeros((64, 80, 2)), 1.0))
    (folder / "003.png").rename(folder / "003b.png")
    assert run(folder, "-o", out, "--resume") == 0
    assert read == ["000.png", "001.png", "002.png", "003b.png", "900.png"]
    after = contents(out)
    assert after["000.png"] == before["000.png"] and after["002.smear.npz"] != before["002.smear.npz"]
    assert json.loads(after["001.json"])["config"] == json.loads(before["001.json"])["config"]

    (out / "004.json").write_text("mine")
    assert run(folder, "-o", out, "--resume") == 1 and (out / "004.json").read_text() == "mine"


@pytest.mark.parametrize("option", [["--seed", 3], ["--beta", 0.2], ["--focal", 160], ["--no-timings"]])
def test_other_options_are_done_again(
    run: Any, folder: Path, tmp_path: Path, read: list[str], option: list[object]
) -> None:
    assert run(folder, "-o", tmp_path / "out") == 0
    read.clear()
    assert run(folder, "-o", tmp_path / "out", "--resume", *option) == 0
    assert len(read) == 5
    assert run(folder, "-o", tmp_path / "out", "--resume", "--max-memory", 1, "-q", *option) == 0
    assert len(read) == 5


def test_other_network_is_done_again(
    run: Any, folder: Path, tmp_path: Path, read: list[str], tiny_model: Path
) -> None:
    shutil.copy(tiny_model, tmp_path / "copy.onnx")
    words = ["estimate", str(folder), "-o", str(tmp_path / "out"), "--jobs", "1", "--resume"]
    for model, count in ((tiny_model, 5), (tmp_path / "copy.onnx", 0), (None, 5)):
        read.clear()
        assert cli.main([*words, *([] if model is None else ["--model", str(model)])]) == 0
        assert len(read) == count


@pytest.mark.parametrize("command", ["estimate", "segment"])
def test_resume_replaces_no_result_of_another_photograph(
    folder: Path, tmp_path: Path, tiny_model: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def call(*words: object) -> int:
        return cli.main([command, "--model", str(tiny_model), "-o", str(out), *map(str, words)])

    out, other = tmp_path / "out", tmp_path / "other" / "000.png"
    other.parent.mkdir()
    shutil.copy(folder / "001.png", other)
    assert call(folder / "000.png") == 0
    before = contents(out)
    capsys.readouterr()
    assert call(other, "--resume") == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert f"is the result of {folder / '000.png'}" in line and contents(out) == before
    assert call(folder / "000.png", "--resume") == 0
    assert call(other, "--resume", "--overwrite") == 0 and contents(out) != before


def test_resume_does_again_what_has_another_name_now(
    run: Any, folder: Path, tmp_path: Path, read: list[str]
) -> None:
    other = tmp_path / "other" / "000.png"
    other.parent.mkdir()
    shutil.copy(folder / "001.png", other)
    out = tmp_path / "out"
    assert run(folder / "000.png", folder / "001.png", "-o", out) == 0
    read.clear()
    assert run(folder / "000.png", other, "-o", out, "--resume") == 0
    assert read == ["000.png", "000.png"]
    assert (out / "in" / "000.json").exists() and (out / "other" / "000.json").exists()


def test_resume_prints_the_documents_of_what_was_done_before(
    run: Any, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    printed = []
    for _ in range(2):
        assert run(folder, "-o", tmp_path / "out", "--resume", "--json") == 0
        printed.append(capsys.readouterr().out)
    assert printed[0] == printed[1] and len(json.loads(printed[0])["estimates"]) == 5


def test_photograph_alone_leaves_no_manifest_unless_it_is_to_be_resumed(
    run: Any, folder: Path, tmp_path: Path
) -> None:
    assert run(folder / "000.png", "-o", tmp_path / "out") == 0
    assert not (tmp_path / "out" / MANIFEST).exists()
    assert run(folder / "000.png", "-o", tmp_path / "out", "--resume") == 0
    assert (tmp_path / "out" / MANIFEST).exists()


def test_run_ends_after_as_many_failures_as_are_allowed_and_goes_on(
    run: Any, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = [folder / f"{n:03d}.png" for n in (1, 3)]
    good = [path.read_bytes() for path in bad]
    for path in bad:
        path.write_text("bad")
    assert run(folder, "-o", tmp_path / "out", "--max-failures", 2) == 1
    printed = capsys.readouterr()
    assert printed.err.splitlines()[-1] == (
        "blur2view: stopped after 4 of 5 photographs; what is done is kept, "
        "the same call with --resume goes on"
    )
    for path, content in zip(bad, good, strict=True):
        path.write_bytes(content)
    assert run(folder, "-o", tmp_path / "out", "--resume") == 0
    assert "5 photographs: 3 done, 2 done before" in capsys.readouterr().out


def test_full_disk_in_mid_run_stops_it_with_one_line_and_is_gone_on_from(
    run: Any, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str], read: list[str],
) -> None:  # fmt: skip
    room = iter(range(3))

    def full(files: Any) -> None:
        if next(room, None) is None:
            raise OSError(28, "No space left on device")
        write_together(files)

    monkeypatch.setattr(job, "write_together", full)
    assert run(folder, "-o", tmp_path / "out") == 1
    error, stopped = capsys.readouterr().err.splitlines()
    assert "No space left on device" in error
    assert stopped.startswith("blur2view: stopped after 4 of 5 photographs")
    monkeypatch.setattr(job, "write_together", write_together)
    read.clear()
    assert run(folder, "-o", tmp_path / "out", "--resume") == 0
    assert read == ["003.png", "004.png"]


def test_manifest_that_was_cut_off_costs_one_line_and_one_photograph(
    run: Any, folder: Path, tmp_path: Path, read: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(folder, "-o", tmp_path / "out") == 0
    manifest = tmp_path / "out" / MANIFEST
    manifest.write_bytes(manifest.read_bytes()[:-20])
    read.clear()
    assert run(folder, "-o", tmp_path / "out", "--resume") == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert "its last line was cut off" in line and read == ["004.png"]


def test_interrupt_keeps_what_is_done_and_says_how_to_go_on(
    run: Any, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def interrupt(path: Path, **options: Any) -> Any:
        if path.name == "003.png":
            raise KeyboardInterrupt
        return read_image(path, **options)

    monkeypatch.setattr(pipeline, "read_image", interrupt)
    assert run(folder, "-o", tmp_path / "out") == 130
    assert capsys.readouterr().err == (
        "blur2view: interrupted after 3 of 5 photographs; what is done is kept, "
        "the same call with --resume goes on\n"
    )
    monkeypatch.setattr(pipeline, "read_image", read_image)
    assert run(folder, "-o", tmp_path / "out", "--resume") == 0
    assert "2 done, 3 done before" in capsys.readouterr().out


def test_report_of_an_interrupted_run_holds_what_is_done_and_is_gone_on_from(
    folder: Path, tmp_path: Path, tiny_model: Path, monkeypatch: pytest.MonkeyPatch, read: list[str]
) -> None:
    def call(*words: object) -> int:
        words = ("report", folder, "--jobs", 1, "--model", tiny_model, "--no-timings", "--no-mask", *words)
        return cli.main([str(word) for word in words])

    assert call("-o", tmp_path / "whole.html") == 0

    def interrupt(path: Path, **options: Any) -> Any:
        if path.name == "003.png":
            raise KeyboardInterrupt
        return read_image(path, **options)

    with monkeypatch.context() as patched:
        patched.setattr(pipeline, "read_image", interrupt)
        assert call("-o", tmp_path / "page.html") == 130
    assert "3 photographs, " in (tmp_path / "page.html").read_text()
    read.clear()
    assert call("-o", tmp_path / "page.html", "--resume") == 0
    assert read == ["003.png", "004.png"]
    assert (tmp_path / "page.html").read_bytes() == (tmp_path / "whole.html").read_bytes()


def test_page_goes_on_where_other_photographs_change_the_shown_names(
    folder: Path, tmp_path: Path, tiny_model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page, other = tmp_path / "page.html", tmp_path / "other"
    words = [f"--model={tiny_model}", "--jobs=1", "--no-mask", "--no-timings", f"-o{page}"]
    given = [str(folder / name) for name in ("000.png", "001.png")]
    assert cli.main(["report", *words, *given]) == 0
    other.mkdir()
    (other / "000.png").write_bytes((folder / "002.png").read_bytes())
    given.append(str(other / "000.png"))
    read: list[str] = []

    def noted(path: Path, **options: Any) -> Any:
        read.append(path.parent.name)
        return read_image(path, **options)

    monkeypatch.setattr(pipeline, "read_image", noted)
    assert cli.main(["report", *words, *given, "--resume"]) == 0
    assert read == ["other"]
    resumed = page.read_bytes()
    assert cli.main(["report", *words, *given, "--overwrite"]) == 0
    assert page.read_bytes() == resumed and f'data-name="{folder.name}/000.png"'.encode() in resumed


def test_database_of_what_is_done_is_replaced_by_one_of_all(
    folder: Path, tmp_path: Path, tiny_model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def call(name: str, *words: object) -> int:
        words = ("to-colmap", "--db", tmp_path / name, folder, "--jobs", 1, "--model", tiny_model, *words)
        return cli.main([str(word) for word in words])

    assert call("whole.db") == 0
    good = (folder / "003.png").read_bytes()
    (folder / "003.png").write_text("bad")
    assert call("new.db") == 1
    partial = (tmp_path / "new.db").read_bytes()
    (folder / "003.png").write_bytes(good)
    assert call("new.db", "--resume") == 0 and (tmp_path / "new.db").read_bytes() != partial
    assert (tmp_path / "new.db").read_bytes() == (tmp_path / "whole.db").read_bytes()
    (tmp_path / "new.db").write_bytes(b"theirs")
    capsys.readouterr()
    for words in ([], ["--resume"]):
        assert call("new.db", *words) == 1
        assert "exists; choose another --db" in capsys.readouterr().err
    assert (tmp_path / "new.db").read_bytes() == b"theirs"


@pytest.mark.parametrize("target", [["--db", "new.db"], ["--format", "matches", "-o", "text"]])
def test_resume_with_fewer_photographs_drops_none(
    folder: Path,
    tmp_path: Path,
    tiny_model: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    target: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)

    def call(*words: object) -> int:
        return cli.main(["to-colmap", *target, "--jobs", "1", "--model", str(tiny_model), *map(str, words)])

    photographs = [folder / name for name in ("000.png", "001.png", "002.png")]
    assert call(*photographs) == 0
    before = contents(tmp_path)
    capsys.readouterr()
    told = "the views of 1 photograph (002.png) would be lost, as this call names them otherwise"
    assert call(*photographs[:2], "--resume") == 1
    assert told in capsys.readouterr().err and contents(tmp_path) == before
    whole = photographs[2].read_bytes()
    photographs[2].write_text("bad")
    assert call(*photographs, "--resume") == 1
    assert told in capsys.readouterr().err
    photographs[2].write_bytes(whole)
    assert call(*photographs, folder / "003.png", "--resume") == 0


def test_frames_of_a_video_are_estimated_in_order(
    run: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    video = write_video(tmp_path / "clip.mp4", 25)
    out = tmp_path / "out"
    assert run(video, "--every", 10, "-o", out) == 0
    assert {path.relative_to(out).as_posix() for path in out.rglob("*.json")} == {
        "clip/000000.json", "clip/000010.json", "clip/000020.json"
    }  # fmt: skip
    document = json.loads((out / "clip/000010.json").read_text())
    assert document["image"] == f"{video}/000010" and (document["width"], document["height"]) == (80, 64)
    assert run(video, "--from", "0.5s", "--to", 20, "--every", 5, "-o", out, "--resume") == 0
    assert "4 photographs: 2 done, 2 done before" in capsys.readouterr().out


def test_frame_beyond_the_end_of_a_video_is_an_error(
    run: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    video = write_video(tmp_path / "clip.mp4", 25)
    assert run(video / "000999", video / "000024") == 1
    printed = capsys.readouterr()
    (line,) = printed.err.splitlines()
    assert f"{video}: has 25 frames, none of number 999" in line and "1 done, 1 failed" in printed.out
    with pytest.raises(ImageError, match="has 25 frames"):
        read_image(video / "000025")


def test_frames_of_a_video_come_into_a_report_and_a_database(tmp_path: Path, tiny_model: Path) -> None:
    video = write_video(tmp_path / "clip.mp4", 25)
    shared = [str(video), "--every", "10", "--jobs", "1", "--model", str(tiny_model)]
    assert cli.main(["report", *shared, "--no-mask", "-o", str(tmp_path / "page.html")]) == 0
    assert "3 photographs, " in (tmp_path / "page.html").read_text()
    table = tmp_path / "new.csv"
    assert cli.main(["to-colmap", *shared, "--db", str(tmp_path / "new.db"), "--csv", str(table)]) == 0
    with closing(sqlite3.connect(tmp_path / "new.db")) as database:
        names = [row[0] for row in database.execute("SELECT name FROM images ORDER BY name")]
    assert names[:2] == ["clip.mp4/000000#close", "clip.mp4/000000#open"] and len(names) == 6
    rows = table.read_text().splitlines()[1:]
    assert [row.split(",")[0] for row in rows] == [f"clip.mp4/{n:06d}" for n in (0, 10, 20)]
    folder = tmp_path / "text"
    assert cli.main(["to-colmap", *shared, "--format", "matches", "-o", str(folder)]) == 0
    assert read_image(folder / "images" / "clip.mp4" / "000010#open").shape == (64, 80, 3)


def test_bad_inputs_cost_one_line_each_and_not_the_others(
    run: Any, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mp4").write_text("text")
    (tmp_path / "list.txt").write_text(f"{folder / '000.png'}\nabsent.png\n")
    words = [tmp_path / "empty", tmp_path / "text.mp4", f"@{tmp_path / 'list.txt'}"]
    assert run(*words) == 1
    printed = capsys.readouterr()
    empty, text, absent = printed.err.splitlines()
    assert "empty: holds no photograph" in empty
    assert "text.mp4: cannot be opened as a video" in text
    assert "absent.png: no such file" in absent
    assert "4 photographs: 1 done, 3 failed" in printed.out
    assert run("@absent.txt") == 1
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize("command", ["estimate", "triage", "to-colmap", "report"])
def test_name_too_long_for_the_system_costs_one_line(
    folder: Path, tmp_path: Path, tiny_model: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    targets = {"estimate": "-o", "triage": "--csv", "to-colmap": "--db", "report": "-o"}
    words = [command, "n" * 5000 + ".png", str(folder), targets[command], str(tmp_path / "target")]
    assert cli.main([*words, "--jobs", "1", "--model", str(tiny_model)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "cannot be read (File name too long)" in line
    assert (tmp_path / "target").exists()


def test_folder_in_the_place_of_a_file_of_hloc_is_one_line(
    folder: Path, tmp_path: Path, tiny_model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "h" / "pairs.txt").mkdir(parents=True)
    words = ["to-colmap", str(folder / "000.png"), "--format", "hloc", "-o", str(tmp_path / "h")]
    assert cli.main([*words, "--model", str(tiny_model)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "pairs.txt: holds more than views" in line


@pytest.mark.parametrize(
    "words",
    [["--every", "0"], ["--jobs", "0"], ["--from", "x"], ["--to", "-3"], ["--max-failures", "0"]]
    + [["--jobs", "2", "--dask", "tcp://a:1"]],
)
def test_wrong_numbers_are_wrong_usage(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(["estimate", "a.jpg", *words])
    assert caught.value.code == 2 and capsys.readouterr().err.startswith("blur2view estimate: ")


def test_resume_without_results_to_keep_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(["estimate", "a.jpg", "--resume"])
    assert caught.value.code == 2 and "-o" in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.slow
def test_two_processes_write_the_same_bytes_as_one(tmp_path: Path, tiny_model: Path) -> None:
    write_photographs(tmp_path / "in", 6)
    shared = ["--model", tiny_model, "--no-timings"]
    for count in (1, 2):
        words = [tmp_path / "in", "-o", tmp_path / f"out{count}", "--jobs", count, *shared]
        code, printed, complaints = finish("estimate", *words)
        assert code == 0 and complaints == ""
        assert printed.count("\n") == 7
    assert contents(tmp_path / "out1") == contents(tmp_path / "out2")


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_killed_run_goes_on_to_what_an_undisturbed_one_gives(
    tmp_path: Path, tiny_model: Path, jobs: int
) -> None:
    write_photographs(tmp_path / "in", 60, (128, 160))
    words = [tmp_path / "in", "--jobs", jobs, "--model", tiny_model, "--no-timings"]
    assert finish("estimate", *words, "-o", tmp_path / "whole")[0] == 0
    killed = start("estimate", *words, "-o", tmp_path / "out")
    manifest = tmp_path / "out" / MANIFEST
    while not manifest.exists() or manifest.read_bytes().count(b"\n") < 6:
        time.sleep(0.01)
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    before = manifest.read_text().count('"outputs"')
    (tmp_path / "out" / ".029.json.999999999.tmp").touch()  # as a process leaves it that is killed
    code, printed, _ = finish("estimate", *words, "-o", tmp_path / "out", "--resume")
    assert code == 0 and before < 60
    assert f"{60 - before} done, {before} done before" in printed
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is another signal there")
def test_interrupt_of_processes_leaves_no_half_written_file(tmp_path: Path, tiny_model: Path) -> None:
    write_photographs(tmp_path / "in", 200, (320, 400))  # more than a busy machine does before it looks
    words = [tmp_path / "in", "--jobs", 2, "--model", tiny_model, "-o", tmp_path / "out"]
    running = start("estimate", *words)
    manifest = tmp_path / "out" / MANIFEST
    while not manifest.exists() or manifest.read_bytes().count(b"\n") < 4:
        time.sleep(0.01)
    running.send_signal(signal.SIGINT)
    _, complaints = running.communicate()
    assert running.returncode == 130
    (line,) = complaints.splitlines()
    assert line.startswith("blur2view: interrupted after") and "--resume" in line
    assert not list((tmp_path / "out").glob(".*.tmp"))
