"""The tool behind ``blur2view triage``: rank correlations, features that blur takes away."""

import cv2
import numpy as np

from tools.benchmarks.triage import matched_share


def texture(seed: int = 0, size: int = 360) -> np.ndarray:
    rng = np.random.default_rng(seed)
    coarse = rng.random((size // 6, size // 6, 3)).astype(np.float32)
    return np.asarray(cv2.resize(coarse, (size, size), interpolation=cv2.INTER_NEAREST))


def test_features_of_a_picture_match_itself_and_nothing_else() -> None:
    assert matched_share(texture(), texture()) > 0.9
    assert matched_share(texture(), texture(1)) < 0.05
    assert matched_share(texture(), np.zeros((360, 360, 3), np.float32)) == 0
