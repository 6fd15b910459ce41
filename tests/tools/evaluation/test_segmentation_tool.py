"""The evaluation of motion masks: its figures on a case whose answer is known."""

import numpy as np
import pytest

from blur2view.movers.mask import MotionMask
from tools.evaluation.segmentation import judge


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
