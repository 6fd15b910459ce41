"""The tool behind ``blur2view triage``: rank correlations, features that blur takes away."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tools.benchmarks.triage import LENGTHS_PX, features_left, limit_of, matched_share
from tools.evaluation.blur_kinds import laplacian_variance


def texture(seed: int = 0, size: int = 360) -> np.ndarray:
    rng = np.random.default_rng(seed)
    coarse = rng.random((size // 6, size // 6, 3)).astype(np.float32)
    return np.asarray(cv2.resize(coarse, (size, size), interpolation=cv2.INTER_NEAREST))


def test_features_of_a_picture_match_itself_and_nothing_else() -> None:
    assert matched_share(texture(), texture()) > 0.9
    assert matched_share(texture(), texture(1)) < 0.05
    assert matched_share(texture(), np.zeros((360, 360, 3), np.float32)) == 0


@pytest.mark.slow
def test_features_get_lost_by_blur_and_the_limit_leaves_half(tmp_path: Path) -> None:
    sharp = texture()
    assert laplacian_variance(sharp) > 4 * laplacian_variance(cv2.blur(sharp, (9, 9)))
    cv2.imwrite(str(tmp_path / "a.png"), (sharp * 255).astype(np.uint8))
    cv2.imwrite(str(tmp_path / "b.png"), np.zeros((40, 40), np.uint8))  # too small, left out
    left = features_left(tmp_path)
    assert left[0] == 1 and left[-1] < 0.5 < left[1]
    limit = limit_of(left)
    assert left[LENGTHS_PX.index(limit)] >= 0.5 > left[LENGTHS_PX.index(limit) + 1]
