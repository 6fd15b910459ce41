"""Studies of blur, of masks and of choosing: what they say of pictures whose answer is known."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from blur2view.movers.mask import MotionMask
from blur2view.records.record import Record
from blur2view.smears.blur import Blur, BlurKind
from tools.datasets import blurred_photographs
from tools.evaluation import blur_kinds, chosen_frames, looks
from tools.evaluation.segmentation import judge
from tools.rendering import video


@pytest.mark.slow
def test_most_kinds_of_blur_of_a_photograph_of_grain_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(blurred_photographs, "RADII_PX", (2, 5))
    monkeypatch.setattr(blurred_photographs, "SMEARS_PX", (4, 12, 25))
    rng = np.random.default_rng(0)
    for k in range(2):
        grain = cv2.GaussianBlur(rng.uniform(0, 1, (256, 320)), (0, 0), 0.8)[..., None]
        pixels = 255 * np.clip(0.5 + (grain - 0.5) * 1.5 + 0.1 * np.eye(3)[k], 0, 1)
        assert cv2.imwrite(str(tmp_path / f"{k}.png"), pixels.round().astype(np.uint8))
    rows = blur_kinds.of_photograph(0, sorted(tmp_path.iterdir()), None, 0, 1)
    clear = [one for one in rows if one.is_clear]
    assert np.mean([one.kind == one.picture.kind for one in clear]) > 0.7
    text = "\n".join(map(str, blur_kinds.page(rows)))
    assert "nan" not in text and "| camera moved 12 px, 1/8 | 1 |" in text and "| 25 px | 1 |" in text


def test_looks_are_compared_with_the_estimate() -> None:
    sharp, moved = Blur(kind=BlurKind.SHARP, smear_px=0.5), Blur(kind=BlurKind.CAMERA_MOVED, smear_px=9.0)
    estimate, cheap = (
        [looks.Look(blur, blur is again, 1.0) for blur in (sharp, moved)] for again in (None, moved)
    )
    wrong = [cheap[0], cheap[1]._replace(blur=sharp)]
    rows = list(looks.rows(list(zip(estimate, cheap, wrong, strict=True)), [48, 96]))
    assert [row[:5] for row in rows] == [
        ("`estimate`", "all", 2, 0, 0),
        ("`triage`", 48, 2, 0, 1),
        ("`triage`", 96, 2, 1, 1),
    ]


def test_masks_are_judged_by_what_moves() -> None:
    static = np.ones((60, 80), bool)
    static[10:50, 20:68] = False
    true = np.kron(~static, np.ones((4, 4))) > 0
    half = true & (np.arange(320) < 4 * 44)
    for found, expected in ((true, (1, 1, 0.4)), (half, (0.5, 0.7, 0.2)), (np.zeros_like(true), (0, 0.4, 0))):
        probability = np.where(found, 0.9, 0.1).astype(np.float32)
        mask = MotionMask(
            labels=found.astype(np.uint8), probability=probability, regions=(), reason="a test's"
        )
        figures = judge(static, np.ones_like(static), mask)
        assert figures["share"] == pytest.approx(0.4)
        assert [figures[name] for name in ("iou", "precision", "called")] == pytest.approx(expected)


def test_choosing_the_least_blurred_has_no_regret_and_any_other_has() -> None:
    true = [3.0, 1.0, 2.0, 4.0, 8.0, 6.0, 5.0]
    assert chosen_frames.least(true, 3) == [1, 3, 6] and chosen_frames.regret(true, [1, 3, 6], 3) == 1
    assert chosen_frames.regret(true, [0, 4, 6], 3) == pytest.approx(16 / 10)
    assert chosen_frames.rank_correlation(true, [-value for value in true]) == pytest.approx(-1)


def test_a_way_to_choose_reads_the_frames_with_most_energy_and_keeps_the_first_by_its_rank() -> None:
    frames = [
        chosen_frames.Frame(
            true=width,
            record=Record(name="", use="blurred", smear_px=width),
            energy=energy,
            squares=0,
            laplacian=0,
        )
        for width, energy in ((2.0, 1.0), (4.0, 9.0), (3.0, 3.0), (9.0, 8.0))
    ]
    kept = {name: way.chosen(frames).true for name, way in chosen_frames.WAYS.items()}
    assert kept["all, width of the blur"] == 2 and kept["a third, width"] == 4  # of the two with most energy
    assert kept["a quarter, width over energy"] == kept["all, energy"] == 4
    (row, *_) = chosen_frames.way_rows([frames * 8])
    assert row[0] == "all, width of the blur" and float(row[-1]) == 1


def test_smears_of_a_video_are_as_long_as_its_exposures() -> None:
    options = video.VideoOptions(rate=30, share=0.5, frames=3, size=(160, 120), focal_px=150, shake_px=4)
    paths = video.sample_exposures(np.random.default_rng([0, 30]), options)
    lengths = video.smear_lengths_px(paths, 0, options)
    halves = [replace(path, exposure_s=path.exposure_s / 2) for path in paths]
    assert video.smear_lengths_px(halves, 0, options) == pytest.approx([one / 2 for one in lengths], rel=0.1)
    assert min(lengths) > 0.5
