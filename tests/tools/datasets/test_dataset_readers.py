"""Readers of the paper's datasets: tiny trees in their true layouts; flow, cameras and F are known."""

from pathlib import Path

import numpy as np
import pytest

from blur2view.errors import Blur2ViewError
from blur2view.geometry.epipolar import fundamental_from_pose, unit_norm
from blur2view.geometry.sampson import sampson
from tests.support.dataset_trees import (
    HEIGHT,
    PIXELS,
    SCENES,
    WIDTH,
    Floats,
    R,
    T,
    homography,
    mapped,
    pfm,
    png,
    sceneflow,
    shifted,
    texture,
)
from tools.datasets import flow as flows
from tools.datasets.exposure import Exposure, coded, linearised
from tools.datasets.gold_standard import gold_standard_fundamental
from tools.datasets.sceneflow import SceneFlow, read_pfm
from tools.datasets.videos import RBI, GoProPairs, GoProSharp


@pytest.mark.parametrize("kind", SCENES)
@pytest.mark.parametrize("side", ["left", "right"])
def test_sceneflow_gives_exact_smears_cameras_and_blur(kind: str, side: str, tmp_path: Path) -> None:
    scene = SCENES[kind]
    H, F = homography(scene)
    found = list(SceneFlow(sceneflow(tmp_path, scene, first=kind == "driving"), side))
    assert [e.name[-4:] for e in found] == (["0001", "0002"] if kind == "driving" else ["0000", "0001"])
    for exposure in found:
        assert exposure.pose is not None and exposure.pose.K[0, 0] == (45 if kind == "driving" else 105)
        np.testing.assert_allclose(exposure.pose.R, R, atol=1e-9)
        np.testing.assert_allclose(exposure.pose.t, T, atol=1e-9)
        true = exposure.fundamental()
        assert true is not None
        np.testing.assert_allclose(true * np.sign(true[0, 1]), F * np.sign(F[0, 1]), atol=1e-9)
        seen = exposure.smears.valid
        assert seen[8:-8, 8:-8].all() and not seen.all()
        d = exposure.smears.displacement[seen]
        start, end = PIXELS[seen] - d / 2, PIXELS[seen] + d / 2
        assert np.abs(mapped(H, start) - end).max() < 0.02 and np.linalg.norm(d, axis=1).max() > 1.5
        assert np.sqrt(sampson(F, start, end)).max() < 0.02
    # the blur: linear light of the wall, averaged along every pixel's path
    flow, taus = mapped(H, PIXELS) - PIXELS, (np.arange(15) + 0.5) / 15
    paths = [flows.sources(flow.astype(np.float32), tau)[0] for tau in taus]
    blurred = np.mean([texture(x.astype(float)) for x in paths], axis=0)
    error = np.abs(found[0].linear - blurred)[8:-8, 8:-8]
    assert np.median(error) < 0.005 and error.max() < 0.03


def test_wrong_or_partial_trees_are_named(tmp_path: Path) -> None:
    def complaint(tree: Path) -> str:
        with pytest.raises(Blur2ViewError) as caught:
            list(SceneFlow(tree))
        assert "\n" not in str(caught.value)
        return str(caught.value)

    assert "no such folder" in complaint(tmp_path / "nowhere")
    root = sceneflow(tmp_path / "whole", "eating_x2", 0)
    frames = root / "frames_cleanpass" / "eating_x2"
    (frames / "left").rename(frames / "links")
    assert "holds no folder left" in complaint(root)
    (frames / "links").rename(frames / "left")
    cameras = root / "camera_data" / "eating_x2" / "camera_data.txt"
    text = cameras.read_text()
    cameras.write_text(text.replace("Frame 1", "Frame 9"))
    assert "lacks frame 0 or 1" in complaint(root)
    cameras.write_text(text.replace("L ", "L x", 1))
    assert "camera_data.txt, line 2" in complaint(root)
    cameras.write_text("")
    assert "no camera of the left side" in complaint(root)
    cameras.write_text(text)
    folder = root / "optical_flow" / "eating_x2" / "into_future" / "left"
    forward = folder / "OpticalFlowIntoFuture_0000_L.pfm"
    whole = forward.read_bytes()
    for broken, word in ((whole[:-4], "cut short"), (b"P6" + whole[2:], "no PFM"), (None, "is missing")):
        forward.write_bytes(broken) if broken else forward.unlink()
        assert word in complaint(root)
    pfm(forward, np.zeros((HEIGHT, WIDTH - 4, 2)))
    assert "differs in size" in complaint(root)
    (root / "optical_flow").rename(root / "flow")
    assert "optical_flow" in complaint(root)


def test_pfm_is_read_from_the_bottom_up_in_both_byte_orders(tmp_path: Path) -> None:
    values = np.random.default_rng(0).normal(size=(3, 5, 2))
    for big in (False, True):
        pfm(tmp_path / "a.pfm", values, big)
        np.testing.assert_allclose(read_pfm(tmp_path / "a.pfm")[..., :2], values, rtol=1e-6)


def test_points_that_are_covered_fail_the_cross_check() -> None:
    forward = np.zeros((HEIGHT, WIDTH, 2), np.float32)
    backward = forward.copy()
    forward[20:40, 30:50] = (12, 0)  # a square before a still wall moves right
    backward[20:40, 42:62] = (-12, 0)
    smears = flows.mid_smears(forward, backward)
    middle = smears.valid[28:32, 40:50]  # at mid exposure the square spans columns 36 to 56
    assert middle.all()
    np.testing.assert_array_equal(smears.displacement[28:32, 40:50], np.broadcast_to([12, 0], (4, 10, 2)))
    assert not smears.valid[28:32, 57:61].any()  # the wall there is covered at the end
    assert smears.valid[:18].all() and not smears.displacement[:18].any()
    assert flows.sub_frames(forward) == flows.FEWEST and flows.sub_frames(5 * forward) == 60


def test_linear_light_survives_coding() -> None:
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16)
    np.testing.assert_array_equal(coded(linearised(codes)), codes)


def test_gold_standard_is_better_than_its_start_and_stands_movers() -> None:
    rng = np.random.default_rng(3)
    K = np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]])
    points = rng.uniform([0, 0], [640, 480], (2000, 2))
    rays = np.c_[points, np.ones(2000)] @ np.linalg.inv(K).T * rng.uniform(1, 4, (2000, 1))
    later = (rays @ R.T + 3 * T) @ K.T
    ends = np.stack([points, later[:, :2] / later[:, 2:]], axis=1)
    true, exact = fundamental_from_pose(K, R, 3 * T), ends.copy()
    ends[:, 1] += 0.2 * rng.normal(size=(2000, 2))
    ends[:500, 1] += rng.uniform(-20, 20, (500, 2))
    found = gold_standard_fundamental(ends)
    assert found is not None and abs(np.linalg.det(found)) < 1e-12
    assert np.median(np.sqrt(sampson(found, exact[:, 0], exact[:, 1]))) < 0.02
    assert gold_standard_fundamental(exact[:7]) is None and gold_standard_fundamental(exact[:0]) is None
    np.testing.assert_allclose(unit_norm(true), true)


def median_smear(exposure: Exposure) -> Floats:
    smears = exposure.smears
    assert smears.valid.mean() > 0.6
    return np.asarray(np.median(smears.displacement[smears.valid], axis=0))


def test_gopro_of_sharp_frames_is_averaged(tmp_path: Path) -> None:
    sequence = tmp_path / "test" / "GOPR0384_05_00"
    for k in range(1, 12):
        png(sequence / f"{k:06d}.png", shifted(1.5 * k))
    found = list(GoProSharp(tmp_path))
    assert [e.name for e in found] == ["GOPR0384_05_00_000001", "GOPR0384_05_00_000006"]
    assert len(list(GoProSharp(tmp_path, window=11))) == 1
    np.testing.assert_allclose(median_smear(found[0]), [6, 0], atol=0.15)
    blurred = np.mean([shifted(1.5 + 6 * (k + 0.5) / 60) for k in range(60)], axis=0)
    inner = np.abs(found[0].linear - blurred)[10:-10, 16:-16]
    assert inner.mean() < 0.01 < np.abs(shifted(1.5) - blurred)[10:-10, 16:-16].mean()
    with pytest.raises(Blur2ViewError, match="kind gopro"):
        GoProSharp(sequence, split=".")
    sequence.rename(sequence.with_name("walk"))
    with pytest.raises(Blur2ViewError, match="GOPR0384_11_00"):
        list(GoProSharp(tmp_path))
    with pytest.raises(ValueError, match="two frames"):
        GoProSharp(tmp_path, window=1)


def test_gopro_of_pairs_takes_smears_from_the_neighbours(tmp_path: Path) -> None:
    sequence = tmp_path / "test" / "GOPR0384_11_00"
    for k in range(1, 4):
        png(sequence / "sharp" / f"{k:06d}.png", shifted(5.5 * k))
        png(sequence / "blur" / f"{k:06d}.png", shifted(5.5 * k))
    found = list(GoProPairs(tmp_path))
    assert [e.name for e in found] == ["GOPR0384_11_00_000002"]
    np.testing.assert_allclose(median_smear(found[0]), [5, 0], atol=0.15)
    for k in range(1, 4):
        png(sequence / "blur_gamma" / f"{k:06d}.png", 0 * shifted(0))
    assert found[0].linear.any() and not next(iter(GoProPairs(tmp_path))).linear.any()
    (sequence / "sharp" / "000003.png").unlink()
    with pytest.raises(Blur2ViewError, match="different frames"):
        list(GoProPairs(tmp_path))
    sequence.rename(sequence.with_name("walk"))
    with pytest.raises(Blur2ViewError, match="GOPR0384_11_00"):
        GoProPairs(tmp_path)
    with pytest.raises(Blur2ViewError, match="gopro-sharp"):
        GoProPairs(tmp_path / "test" / "walk", split="sharp")


def test_rbi_takes_the_sharp_frames_of_the_exposure(tmp_path: Path) -> None:
    for k in (1, 9, 21, 29):
        png(tmp_path / "Sharp" / "_Scene7" / "RGB" / f"{k}.png", shifted(k if k < 20 else 0.5 * k))
    for k in (1, 2):
        png(tmp_path / "Blur" / "_Scene7" / "RGB" / f"{k}.png", shifted(5 * k))
    found = list(RBI(tmp_path))
    assert [e.name for e in found] == ["Scene7_0001", "Scene7_0002"]
    for exposure, length in zip(found, (8, 4), strict=True):
        np.testing.assert_allclose(median_smear(exposure), [length, 0], atol=0.15)
        assert exposure.pose is None and exposure.K[0, 0] == 1.2 * WIDTH
    (tmp_path / "Sharp" / "_Scene7" / "RGB" / "29.png").unlink()
    with pytest.raises(Blur2ViewError, match=r"29\.png: is missing"):
        list(RBI(tmp_path))
    with pytest.raises(Blur2ViewError, match="Blur: no such folder, RBI"):
        RBI(tmp_path / "Blur")
