"""What is written: in place of what, through which links, and what a full disk leaves."""

import resource
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.support.calls import Call, table
from tests.support.colour_code import colour_code, write_picture
from tests.support.many_photographs import command, contents, environment, start


def test_only_results_of_blur2view_are_replaced(run: Call, moving: Path, still: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    for _ in range(2):
        assert run(moving, "-o", out) == 0
    for name, theirs in (("moving.png", "mine"), ("moving.json", '{"model_id": "mine"}')):
        ours = (out / name).read_bytes()
        (out / name).write_text(theirs)
        done = run(moving, still, "-o", out)
        assert done == 1 and f"{out / name}: already exists and was not written by blur2view" in done.line
        assert (out / name).read_text() == theirs and (out / "still.json").exists()
        (out / name).write_bytes(ours)


def test_a_link_stays_one_and_what_it_leads_to_is_written(call: Call, frames: Path, tmp_path: Path) -> None:
    (link := tmp_path / "link.csv").symlink_to(tmp_path / "far.csv")
    for _ in range(2):
        assert call("triage", frames, "--csv", link) == 0
        assert link.is_symlink() and len(table(tmp_path / "far.csv")) == 2


def test_labels_that_a_user_added_to_a_table_are_not_replaced(call: Call, still: Path, here: Path) -> None:
    words = ("triage", still, "--csv", "t.csv")
    assert call(*words) == call(*words) == 0
    labelled = Path("t.csv").read_text().replace("name,", "label,name,")
    Path("t.csv").write_text(labelled)
    done = call(*words)
    assert done == 1 and "t.csv: has changed since blur2view wrote it" in done.line
    assert Path("t.csv").read_text() == labelled


def test_two_calls_on_one_folder_lose_nothing(frames: Path, tmp_path: Path, tiny_model: Path) -> None:
    words = ["estimate", frames, "--model", tiny_model, "--jobs", 1, "-o", tmp_path / "out"]
    running = [start(*words) for _ in range(2)]
    assert [process.wait() for process in running] == [0, 0]
    for process in running:
        process.communicate()
    assert len(contents(tmp_path / "out")) == 6


def test_an_input_is_never_replaced(call: Call, frames: Path, here: Path) -> None:
    shutil.copy(frames / "still.png", "a.png")
    before = contents(here)
    for words in ("report --no-mask -o a.png", "estimate -o .", "triage --csv a.png"):
        done = call(*words.split(), "a.png")
        assert done == 1 and "would replace an input" in done.line
        assert contents(here) == before


def test_every_command_writes_the_same_rows(call: Call, moving: Path, still: Path, tmp_path: Path) -> None:
    words = (moving, still, "--focal", 300, "--csv")
    target = {"report": ["--no-mask", "-o", tmp_path / "a.html"], "to-colmap": ["--db", tmp_path / "a.db"]}
    assert call("estimate", *words, tmp_path / "whole.csv") == 0
    whole = table(tmp_path / "whole.csv")
    for name in ("segment", "report", "to-colmap"):
        assert call(name, *words, tmp_path / f"{name}.csv", *target.get(name, [])) == 0
        for one, other in zip(whole, table(tmp_path / f"{name}.csv"), strict=True):
            for column in ("name", "blur", "config", "verdict", "smear_px", "use"):
                assert one[column] == other[column]
    assert float(whole[0]["rotation_deg"]) >= 0


def test_killed_while_overwriting_is_done_again(
    run: Call, moving: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(moving, "-o", tmp_path / "out") == 0
    before = contents(tmp_path / "out")
    rename = Path.replace

    def killed(self: Path, target: Path) -> Path:
        if target.suffix == ".png":
            raise KeyboardInterrupt
        return rename(self, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", killed)
        assert run(moving, "-o", tmp_path / "out", "--focal", 300) == 130
    assert contents(tmp_path / "out").keys() == before.keys()  # none is lost
    done = run(moving, "-o", tmp_path / "out", "--resume")
    assert done == 0 and "done before" not in done.out and contents(tmp_path / "out") == before


def test_photographs_of_one_stem_keep_their_subfolders_or_suffixes(
    run: Call, still: Path, tmp_path: Path
) -> None:
    pixels = colour_code(np.zeros((48, 64, 2)), 1.0)
    images = [tmp_path / name for name in ("a/x.tif", "b/x.tif", "b/x.png", "c/x.tif")]
    for image in images[:3]:
        image.parent.mkdir(exist_ok=True)
        write_picture(image, pixels)
    out = tmp_path / "out"
    done = run(*images, still, still, "-o", out)
    assert done == 1 and "c/x.tif: no such file" in done.line
    found = {str(path.relative_to(out)) for path in out.rglob("*.json")}
    assert found == {"a/x.json", "b/x.tif.json", "b/x.png.json", "still.json"}
    assert not (out / "c").exists()


def test_a_stem_as_long_as_a_name_may_be_is_written(run: Call, still: Path, tmp_path: Path) -> None:
    long = still.rename(tmp_path / f"{'a' * 240}.png")
    assert run(long, "-o", tmp_path / "out") == 0
    assert len(list((tmp_path / "out").iterdir())) == 3


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="limits the size of files")
@pytest.mark.parametrize(
    "words", [["estimate", "-o", "out"], ["triage", "--csv", "t.csv"], ["report", "-o", "page.html"]]
)
def test_a_full_disk_is_clear_lines_and_loses_nothing(
    call: Call, tiny_model: Path, frames: Path, here: Path, words: list[str]
) -> None:
    assert call(*words, frames, "--recursive") == 0
    before = contents(here)

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (512, 512))  # as if there were room for no more

    line = command(*words, frames, "--recursive", "--model", tiny_model, "--jobs", 1)
    full = subprocess.run(line, env=environment(), capture_output=True, text=True, preexec_fn=limit)
    assert full.returncode == 1 and "Traceback" not in full.stderr
    assert "File too large" in full.stderr and len(full.stderr.splitlines()) <= 2
    after = contents(here)
    assert {name: after[name] for name in before} == before


def test_kernels_lie_beside_the_estimate_and_are_replaced_by_the_next_call(
    run: Call, moving: Path, tmp_path: Path
) -> None:
    for _ in range(2):
        assert run(moving, "-o", tmp_path / "out", "--kernels") == 0
        with np.load(tmp_path / "out/moving.kernels.npz") as arrays:
            assert arrays["whole"].sum() == pytest.approx(1, abs=1e-5)
            assert arrays["blur_kernels"].shape == (*arrays["known"].shape, *arrays["whole"].shape)
    assert run(moving, "--kernels") == 2


def test_a_table_on_standard_output_comes_alone(
    call: Call, moving: Path, still: Path, tmp_path: Path
) -> None:
    table = tmp_path / "t.csv"
    for words in (["triage", "--keep", tmp_path / "k.txt"], ["report", "-o", tmp_path / "a.html"]):
        assert call(*words, moving, still, "--csv", table) == 0
        done = call(*words, moving, still, "--csv", "-")
        assert done == 0 and done.out == table.read_text()
    assert call("estimate", still, "--csv", "-", "--json") == 2


def test_a_table_called_as_the_folder_of_results_is_refused_before_the_work(
    call: Call, still: Path, here: Path, read: list[str]
) -> None:
    done = call("estimate", still, "--csv", "o", "-o", "o")
    assert done == 1 and "o: is the folder of other results; name another file with --csv" in done.line
    assert read == [] and not Path("o").exists()
