"""The evaluation of motion masks: its figures on cases whose answer is known."""

import numpy as np
import pytest

from blur2view.movers.mask import MotionMask
from tests.support.motion_scenes import HEIGHT, WIDTH
from tools.evaluation.segmentation import judge, overlap
from tools.metrics import average_precision


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


def masked(moving: np.ndarray) -> MotionMask:
    """Give the mask that calls this moving."""
    probability = np.where(moving, 0.9, 0.1).astype(np.float32)
    return MotionMask(labels=moving.astype(np.uint8), probability=probability, regions=(), reason="a test's")


def test_masks_are_judged_by_what_moves() -> None:
    static = np.ones((HEIGHT // 4, WIDTH // 4), bool)
    static[10:50, 20:68] = False
    true = np.kron(~static, np.ones((4, 4))) > 0
    figures = judge(static, np.ones_like(static), masked(true))
    assert figures["iou"] == figures["precision"] == 1
    assert figures["called"] == figures["share"] == pytest.approx(40 * 48 / 19200)
    unseen = judge(static, np.ones_like(static), masked(np.zeros_like(true)))
    assert unseen["iou"] == 0 and unseen["called"] == 0 and unseen["precision"] < 0.2
