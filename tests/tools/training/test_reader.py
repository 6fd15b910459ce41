"""The spectral reader: what turns with the picture, what its layers compute, and what it is fitted to."""

import numpy as np
import pytest
import torch

from blur2view.networks.spectra import LAGS
from blur2view.smears.likelihood import BINS, DIRECTIONS, read_smears
from tools.training.reader import SCALARS, Reader, ReaderOptions, target_of

SMALL = ReaderOptions(window=8, region=12)


def some_octaves() -> list[tuple[torch.Tensor, torch.Tensor]]:
    """Return features of two octaves, of any values."""
    torch.manual_seed(1)
    sizes = ((4, 5), (2, 3))
    return [(torch.randn(1, h, w, DIRECTIONS, LAGS), torch.randn(1, h, w, SCALARS)) for h, w in sizes]


def test_without_the_lattice_directions_are_treated_alike() -> None:
    torch.manual_seed(0)
    network, given = Reader(SMALL).eval(), some_octaves()
    turned = [(torch.roll(cepstra, 8, -2), scalars) for cepstra, scalars in given]
    with torch.no_grad():
        assert (network(turned)[0][0] - torch.roll(network(given)[0][0], 8, -2)).abs().max() > 1e-3
        network.lattice.zero_()
        for one, same in zip(network(turned), network(given), strict=True):
            torch.testing.assert_close(one[0], torch.roll(same[0], 8, -2), atol=1e-4, rtol=1e-4)
            torch.testing.assert_close(one[1:], same[1:], atol=1e-4, rtol=1e-4)


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
