"""The evaluation of motion masks: its figures on cases whose answer is known."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from blur2view.segmentation.mask import MotionMask
from tests.support.motion_scenes import BOX, HEIGHT, SIDEWAYS, WIDTH, with_mover
from tools.datasets import mover_scenes
from tools.datasets.mover_scenes import LARGEST
from tools.datasets.testset import TestScene, read_test_set
from tools.evaluation.segmentation import judge, overlap
from tools.metrics import average_precision
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


def masked(moving: np.ndarray) -> MotionMask:
    """Give the mask that calls this moving."""
    probability = np.where(moving, 0.9, 0.1).astype(np.float32)
    return MotionMask(labels=moving.astype(np.uint8), probability=probability, regions=(), reason="a test's")


def test_masks_are_judged_by_what_moves() -> None:
    true = np.kron(~scene().static, np.ones((4, 4))) > 0
    figures = judge(scene(), masked(true))
    assert figures.iou == figures.precision == 1 and figures.unobservable == 0
    assert figures.called == figures.share == pytest.approx(40 * 48 / 19200)
    assert figures.counts[0].sum() == 19200 and figures.counts[1].sum() == figures.counts[1][9] == 40 * 48
    unseen = judge(scene(), masked(np.zeros_like(true)))
    assert unseen.iou == 0 and unseen.called == 0 and unseen.precision < 0.2


@pytest.mark.slow
def test_mover_scenes_hold_movers_or_give_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = RenderOptions(size=(96, 64), smear_px=(3.0, 20.0), sharp_share=0, split="test", mover_share=1.0)
    mover_scenes.write_rendered(
        tmp_path, 2, options, 6_000_000, lambda s: 0.02 <= (s.valid & ~s.static).mean() <= LARGEST
    )
    scenes = read_test_set(tmp_path)
    assert [one.name for one in scenes] == ["0000", "0001"]
    for one in scenes:
        assert 0.02 <= (one.valid & ~one.static).mean() <= LARGEST
        assert cv2.imread(str(one.image_path)) is not None
    monkeypatch.setattr(mover_scenes, "TRIES", 2)
    with pytest.raises(SystemExit, match="only 0 of 1 scenes suit, of 2 seeds"):
        mover_scenes.write_rendered(tmp_path, 1, RenderOptions(size=(48, 32)), 0, lambda _: False)
