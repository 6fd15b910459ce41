"""The command ``tools.datasets``: exposures of the paper's datasets in our formats."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blur2view.geometry.sampson import sampson
from tests.support.dataset_trees import HEIGHT, WIDTH, png, sceneflow, shifted
from tools.datasets import __main__ as command
from tools.datasets.sceneflow import SceneFlow
from tools.datasets.shards import load_shards
from tools.datasets.testset import read_test_set
from tools.datasets.videos import RBI, GoProPairs, GoProSharp
from tools.evaluation.evaluate import true_ends


def run(words: Iterable[object], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["datasets", *map(str, words)])
    command.main()


def test_command_writes_our_formats(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = sceneflow(tmp_path / "Monkaa", "eating_x2", 0)
    run([root, "--kind", "monkaa", "--out", tmp_path / "split"], monkeypatch)
    first, second = read_test_set(tmp_path / "split")
    assert second.name == "0001" and first.displacement.shape == (HEIGHT // 4, WIDTH // 4, 2)
    F, ends = first.F, true_ends(first)
    assert F is not None and np.sqrt(sampson(F, ends[:, 0], ends[:, 1])).max() < 0.02
    assert "0001 monkaa clean eating_x2_left_0001" in (tmp_path / "split" / "origins.txt").read_text()
    run([root, "--kind", "monkaa", "--out", tmp_path / "shards", "--train", "--most", 1], monkeypatch)
    scenes = load_shards(tmp_path / "shards")
    assert scenes.linear.shape == (1, HEIGHT, WIDTH, 3)
    np.testing.assert_allclose(scenes.displacement[0], first.displacement, atol=0.01)
    with pytest.raises(SystemExit, match=re.escape(str(tmp_path / "Driving"))):
        run([tmp_path / "Driving", "--kind", "driving", "--out", tmp_path / "x"], monkeypatch)


def test_scenes_of_another_call_are_kept_and_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root, split = sceneflow(tmp_path / "Monkaa", "eating_x2", 0), tmp_path / "split"
    call = [root, "--kind", "monkaa", "--out", split]
    run(call, monkeypatch)
    names, scene = (split / "origins.txt").read_text(), (split / "0000.npz").read_bytes()
    for other in (["--side", "right"], ["--pass", "final"], ["--kind", "driving"]):
        if "final" in other:
            (root / "frames_cleanpass").rename(root / "frames_finalpass")
        with pytest.raises(SystemExit, match=r"0000\.npz: is monkaa clean eating_x2_left_0000, not .*; name"):
            run([*call, *other], monkeypatch)
        if "final" in other:
            (root / "frames_finalpass").rename(root / "frames_cleanpass")
    assert (split / "origins.txt").read_text() == names and (split / "0000.npz").read_bytes() == scene
    run(call, monkeypatch)
    (split / "0001.npz").write_bytes(scene[:-100])
    with pytest.raises(SystemExit, match=r"0001\.npz: does not say what it is, not .*; name .* remove it"):
        run(call, monkeypatch)


def test_a_stopped_scene_is_not_taken_for_finished(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root, split = sceneflow(tmp_path / "Monkaa", "eating_x2", 0), tmp_path / "split"
    savez = np.savez

    def stopped(file: Any, **arrays: Any) -> None:
        savez(file, K=arrays["K"])
        raise KeyboardInterrupt

    monkeypatch.setattr("tools.datasets.convert.np.savez", stopped)
    with pytest.raises(KeyboardInterrupt):
        run([root, "--kind", "monkaa", "--out", split], monkeypatch)
    assert not list(split.glob("*.npz")) and not list(split.glob(".*"))
    monkeypatch.undo()
    run([root, "--kind", "monkaa", "--out", split], monkeypatch)
    assert len(list(read_test_set(split))) == 2


def test_exposures_passed_over_are_not_read(tmp_path: Path) -> None:
    sequence, pairs = tmp_path / "all/test/GOPR0384_02_00", tmp_path / "large/test/GOPR0384_11_00"
    for k in range(1, 7):  # the exposures are 1 and 2, 3 and 4, 5 and 6
        png(sequence / f"{k:06d}.png", shifted(1.5 * k))
    (sequence / "000003.png").write_bytes(b"")
    found = command.thinned(GoProSharp(tmp_path / "all"), every=2, most=9)
    assert [e.name[-6:] for e in found] == ["000001", "000005"]
    for k in range(1, 6):  # the exposures are 2, 3 and 4
        png(pairs / "sharp" / f"{k:06d}.png", shifted(5.5 * k))
        png(pairs / "blur" / f"{k:06d}.png", shifted(5.5 * k))
    (pairs / "blur" / "000003.png").write_bytes(b"")
    found = command.thinned(GoProPairs(tmp_path / "large"), every=2, most=9)
    assert [e.name[-6:] for e in found] == ["000002", "000004"]
    for k in (1, 9, 41, 49):
        png(tmp_path / "Sharp" / "_Scene7" / "RGB" / f"{k}.png", shifted(k % 20))
    for k in (1, 2, 3):
        png(tmp_path / "Blur" / "_Scene7" / "RGB" / f"{k}.png", shifted(5 * k))
    assert [e.name for e in command.thinned(RBI(tmp_path), 2, 9)] == ["Scene7_0001", "Scene7_0003"]
    root = sceneflow(tmp_path / "Monkaa", "eating_x2", 0)
    (root / "optical_flow/eating_x2/into_future/left/OpticalFlowIntoFuture_0001_L.pfm").unlink()
    assert [e.name[-4:] for e in command.thinned(SceneFlow(root), 2, 9)] == ["0000"]
