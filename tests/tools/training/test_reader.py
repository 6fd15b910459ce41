"""The spectral reader: what it is fitted to."""

import numpy as np
import pytest
import torch

from blur2view.smears.likelihood import BINS, DIRECTIONS, read_smears
from tools.training.reader import target_of


@pytest.mark.parametrize("k", [0, 7, 31])
@pytest.mark.parametrize("j", [4, 9, 18])
def test_target_is_a_distribution_with_its_maximum_at_the_truth(k: int, j: int) -> None:
    length, angle = 2.0 * 2 ** ((j - 1) / 4), np.pi * k / DIRECTIONS
    d = torch.tensor([length * np.cos(angle), length * np.sin(angle)], dtype=torch.float32)
    target, weight = target_of(d.expand(2, 3, 16, 2), torch.ones(2, 3, 16), BINS)
    assert target.shape == (2, 3, DIRECTIONS, BINS) and (weight == 1).all()
    torch.testing.assert_close(target.sum((-1, -2)), torch.ones(2, 3))
    assert divmod(int(target[0, 0].argmax()), BINS) == (k, j)
    x, y = read_smears(np.log(target[0, 0].numpy() + 1e-12)[None, None])[0, 0, :2]  # a double angle
    assert np.hypot(x, y) == pytest.approx(length, rel=0.05)
    assert np.abs(np.angle(np.exp(1j * (np.arctan2(y, x) - 2 * angle)))) < 0.02
    backwards, _ = target_of(-d.expand(16, 2), torch.ones(16), BINS)
    torch.testing.assert_close(backwards, target[0, 0], atol=1e-4, rtol=1e-3)
