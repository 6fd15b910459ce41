"""The evaluation of motion masks: its figures on cases whose answer is known."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from blur2view.pipeline import Estimate
from blur2view.segmentation.mask import MotionMask
from tests.support.motion_scenes import BOX, HEIGHT, SIDEWAYS, WIDTH, estimate_of, sideways, with_mover
from tools.datasets import mover_scenes
from tools.datasets.mover_scenes import LARGEST, moving_share
from tools.datasets.testset import TestScene, read_test_set
from tools.evaluation.segmentation import average_precision, judge, overlap, squared_residual
from tools.rendering.render import RenderOptions


def test_average_precision_and_overlap_of_known_cases() -> None:
    moving = np.array([True, True, False, False])
    assert average_precision(np.array([4.0, 3, 2, 1]), moving) == 1
    np.testing.assert_allclose(average_precision(np.array([1.0, 2, 3, 4]), moving), (1 / 3 + 2 / 4) / 2)
    np.testing.assert_allclose(average_precision(np.zeros(4), moving), 0.5)  # ties: the share of movers
    other = np.array([True, False, True, False])
    assert overlap(moving, moving) == 1 and overlap(moving, ~moving) == 0
    np.testing.assert_allclose(overlap(moving, other), 1 / 3)
    none = np.zeros(4, bool)
    assert np.isnan([average_precision(np.zeros(4), none), overlap(none, none)]).all()


def scene() -> TestScene:
    static = np.ones((HEIGHT, WIDTH), bool)
    static[BOX] = False
    return TestScene(
        name="0000",
        image_path=Path("none"),
        displacement=with_mover()[1::4, 1::4],
        valid=np.ones((HEIGHT // 4, WIDTH // 4), bool),
        static=static[1::4, 1::4],
        K=np.eye(3),
        R=np.eye(3),
        t=np.array([1.0, 0, 0]),
        F=SIDEWAYS,
        kind="translation",
    )


def masked(found: Estimate) -> MotionMask:
    """Give the mask that the estimate's lines alone would draw."""
    shape = (HEIGHT, WIDTH)
    plain = np.kron(squared_residual(found, (HEIGHT // 4, WIDTH // 4)), np.ones((4, 4)))
    moving = plain > 3
    return MotionMask(
        labels=moving.astype(np.uint8),
        probability=np.clip(plain / 200, 0, 1).astype(np.float32).reshape(shape),
        regions=(),
        reason="told by the test",
    )


def test_perfect_smears_are_judged_nearly_perfect() -> None:
    found = estimate_of(with_mover(), F=SIDEWAYS)
    figures = judge(scene(), found, masked(found))
    assert figures.iou > 0.6 and figures.precision > 0.9 and figures.called > 0
    assert figures.precision == figures.precision_baseline and figures.unobservable == 0
    blind = estimate_of(sideways(), F=SIDEWAYS)  # smears that do not show the mover
    unseen = judge(scene(), blind, masked(blind))
    assert unseen.iou == 0 and unseen.called == 0 and unseen.precision < 0.2
    assert figures.recall > 0.9  # the mover is 160 px wide, its smear 24 px long
    np.testing.assert_allclose(figures.share, 40 * 48 / 19200)
    assert figures.counts[0].sum() == 19200 and figures.counts[1].sum() == 40 * 48


@pytest.mark.slow
def test_mover_scenes_hold_movers_or_give_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = RenderOptions(size=(96, 64), smear_px=(3.0, 20.0), sharp_share=0, split="test", mover_share=1.0)
    mover_scenes.write_rendered(tmp_path, 2, options, 6_000_000, lambda s: 0.02 <= moving_share(s) <= LARGEST)
    scenes = list(read_test_set(tmp_path))
    assert [one.name for one in scenes] == ["0000", "0001"]
    for one in scenes:
        assert 0.02 <= (one.valid & ~one.static).mean() <= LARGEST
        assert cv2.imread(str(one.image_path)) is not None
    monkeypatch.setattr(mover_scenes, "TRIES", 2)
    with pytest.raises(SystemExit, match="only 0 of 1 scenes suit, of 2 seeds"):
        mover_scenes.write_rendered(tmp_path, 1, RenderOptions(size=(48, 32)), 0, lambda _: False)
