"""What the network's fixed features see: lags that tell lengths, and no farther than a training crop."""

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from tools.paper.networks import StemUNet
from tools.paper.stem import LagStem, OrientedStem, StructureStem

LAGS_PX = [4, 6, 10, 16, 24, 36, 52]
DIRECTIONS = LagStem.directions


def textured(seed: int, side: int = 256) -> NDArray[np.float32]:
    noise = np.random.default_rng(seed).random((side, side), dtype=np.float32)
    return np.asarray(cv2.GaussianBlur(noise, (0, 0), 1.0), np.float32)


def lag_features(grey: NDArray[np.float32]) -> NDArray[np.float32]:
    """Mean features, (lags, directions), over the middle of a grey picture brought to ordinary contrast."""
    picture = (grey - grey.mean()) / grey.std() * 0.15 + 0.5
    image = torch.from_numpy(np.repeat(picture[None, None].astype(np.float32), 3, axis=1))
    with torch.no_grad():
        features = StructureStem()(image)[0, -LagStem.channels - OrientedStem.channels :, 20:-20, 20:-20]
    features = features[: LagStem.channels]
    return np.asarray(features.mean((1, 2)).reshape(len(LAGS_PX), DIRECTIONS))


@pytest.mark.parametrize("length", [10, 16, 24, 36])
def test_gradient_along_a_smear_repels_itself_at_its_length(length: int) -> None:
    features = lag_features(np.asarray(cv2.blur(textured(length), (length, 1)), np.float32))
    assert LAGS_PX[int(np.argmin(features[:, 0]))] == length
    assert features[:, 0].min() < -0.3
    assert features[:, 0].min() < features[2:, DIRECTIONS // 2].min() - 0.1


def oriented_features(grey: NDArray[np.float32]) -> NDArray[np.float32]:
    """Mean log energies, (levels, directions), over the middle of a grey picture."""
    image = torch.from_numpy(np.repeat(grey[None, None].astype(np.float32), 3, axis=1))
    with torch.no_grad():
        features = StructureStem()(image)[0, -OrientedStem.channels :, 8:-8, 8:-8]
    return np.asarray(features.mean((1, 2)).reshape(OrientedStem.levels, OrientedStem.directions))


@pytest.mark.parametrize("turn", [0, 1, 3, 6])
def test_fine_detail_is_left_across_a_smear_only(turn: int) -> None:
    directions = OrientedStem.directions
    kernel, reach = np.zeros((33, 33), np.float32), 12
    along = np.array([np.cos(np.pi * turn / directions), np.sin(np.pi * turn / directions)])
    ends = [tuple(np.rint((16 + s * reach * along) * 16).astype(int).tolist()) for s in (-1, 1)]
    cv2.line(kernel, ends[0], ends[1], 1.0, 1, cv2.LINE_AA, 4)
    blurred = cv2.filter2D(textured(turn), -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT)
    features = oriented_features(np.asarray(blurred, np.float32))
    across = (turn + directions // 2) % directions
    assert (features.argmax(1) == across).all()
    assert (features[:, across] - features[:, turn] > 1.5).all()


def test_the_network_sees_no_farther_than_a_training_crop() -> None:
    torch.manual_seed(0)
    network = StemUNet().eval()
    image = torch.rand(1, 3, 384, 384)
    changed = image.clone()
    changed[..., :32] = 0.1  # 160 px left of the middle
    with torch.no_grad():
        difference = (network(image) - network(changed)).abs()[0, :, 48, :]
    assert difference[:, 48].max() < 1e-6
    assert difference[:, 4].max() > 1e-3


@pytest.mark.parametrize(
    ("direction", "double_angle"), [((1, 0), (1, 0)), ((0, 1), (-1, 0)), ((1, 1), (0, 1)), ((1, -1), (0, -1))]
)
def test_stem_sees_the_gradients_double_angle(
    direction: tuple[int, int], double_angle: tuple[int, int]
) -> None:
    y, x = np.mgrid[:128, :128]
    slope = direction[0] * x + direction[1] * y
    grey = torch.from_numpy((slope - slope.min()) / np.ptp(slope)).float().expand(1, 3, -1, -1)
    features = StructureStem()(grey)
    assert features.shape == (1, StructureStem.channels, 32, 32)
    energy = (direction[0] ** 2 + direction[1] ** 2) / np.ptp(slope) ** 2
    for level in range(4):
        coherence = energy * 4**level / (energy * 4**level + 2e-5)
        seen = features[0, 16 + 2 * level : 18 + 2 * level, 8:-8, 8:-8]
        for channel, expected in zip(seen, double_angle, strict=True):
            np.testing.assert_allclose(channel, expected * coherence, atol=1e-3)
        log_energy = features[0, 24 + level, 8:-8, 8:-8]
        np.testing.assert_allclose(log_energy, (np.log(energy * 4**level + 1e-6) + 6) / 3, atol=1e-3)


def test_stem_is_finite_on_a_constant_image() -> None:
    features = StructureStem()(torch.full((1, 3, 64, 64), 0.3))
    assert torch.isfinite(features).all()
    assert features[:, :16].abs().max() < 1e-3 and features[:, 16:24].abs().max() < 1e-3
