"""``blur2view estimate -o``: what is replaced, refused or left alone."""

from pathlib import Path

import numpy as np
import pytest

from tests.support.calls import Call
from tests.support.colour_code import colour_code, write_picture
from tests.support.many_photographs import contents


def test_only_results_of_an_earlier_call_are_replaced(
    run: Call, moving: Path, still: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert run(moving, "-o", out) == 0
    (out / "moving.json").unlink()  # as a kill leaves it
    assert run(moving, "-o", out, "--overwrite") == 0
    for name in ("moving.png", "moving.json"):  # the others are ours
        ours = (out / name).read_bytes()
        (out / name).write_text("mine")
        done = run(moving, still, "-o", out, "--overwrite")
        assert done == 1 and f"{out / name}: is no result of an earlier call" in done.line
        assert (out / name).read_text() == "mine" and (out / "still.json").exists()
        (out / name).write_bytes(ours)


def test_killed_while_overwriting_leaves_no_document_beside_new_arrays(
    run: Call, moving: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(moving, "-o", tmp_path / "out") == 0
    rename = Path.replace

    def killed(self: Path, target: Path) -> Path:
        if target.suffix == ".png":
            raise KeyboardInterrupt
        return rename(self, target)

    monkeypatch.setattr(Path, "replace", killed)
    assert run(moving, "-o", tmp_path / "out", "--overwrite") == 130
    assert sorted(contents(tmp_path / "out")) == ["moving.png", "moving.smear.npz"]


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


def test_full_disk_leaves_no_half_written_file(
    run: Call, still: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(self: Path, content: bytes) -> int:
        self.touch()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    done = run(still, "-o", tmp_path / "out")
    assert done == 1 and "No space left on device" in done.line
    (bad := tmp_path / "bad.png").write_text("bad")
    assert run(bad, "-o", tmp_path / "out") == 1
    assert not (tmp_path / "out").exists()  # nothing succeeded, so nothing is left behind


def test_a_result_that_leads_to_a_photograph_is_refused(run: Call, moving: Path, tmp_path: Path) -> None:
    before, out = moving.read_bytes(), tmp_path / "out"
    out.mkdir()
    (out / "moving.json").symlink_to(moving)
    for place in (moving.parent, out):
        done = run(moving, "-o", place, "--overwrite")
        assert done == 1 and "would replace a photograph" in done.line and moving.read_bytes() == before
