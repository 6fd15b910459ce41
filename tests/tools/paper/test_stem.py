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


def features_of(grey: NDArray[np.float32]) -> torch.Tensor:
    """Features (channels, h, w) of a grey picture (H, W), without those near the border."""
    image = torch.from_numpy(np.repeat(grey[None, None].astype(np.float32), 3, axis=1))
    with torch.no_grad():
        seen: torch.Tensor = StructureStem()(image)[0, :, 20:-20, 20:-20]
    return seen


@pytest.mark.parametrize("length", [10, 16, 24, 36])
def test_gradient_along_a_smear_repels_itself_at_its_length(length: int) -> None:
    grey = np.asarray(cv2.blur(textured(length), (length, 1)), np.float32)
    seen = features_of((grey - grey.mean()) / grey.std() * 0.15 + 0.5)  # of ordinary contrast
    lags = seen[-LagStem.channels - OrientedStem.channels :][: LagStem.channels].mean((1, 2))
    features = lags.reshape(len(LAGS_PX), DIRECTIONS).numpy()
    assert LAGS_PX[int(np.argmin(features[:, 0]))] == length
    assert features[:, 0].min() < -0.3
    assert features[:, 0].min() < features[2:, DIRECTIONS // 2].min() - 0.1


@pytest.mark.parametrize("turn", [0, 1, 3, 6])
def test_fine_detail_is_left_across_a_smear_only(turn: int) -> None:
    directions = OrientedStem.directions
    kernel, reach = np.zeros((33, 33), np.float32), 12
    along = np.array([np.cos(np.pi * turn / directions), np.sin(np.pi * turn / directions)])
    ends = [tuple(np.rint((16 + s * reach * along) * 16).astype(int).tolist()) for s in (-1, 1)]
    cv2.line(kernel, ends[0], ends[1], 1.0, 1, cv2.LINE_AA, 4)
    blurred = cv2.filter2D(textured(turn), -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT)
    energies = features_of(np.asarray(blurred, np.float32))[-OrientedStem.channels :].mean((1, 2))
    features = energies.reshape(OrientedStem.levels, directions).numpy()
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
    assert torch.isfinite(StructureStem()(torch.full((1, 3, 64, 64), 0.3))).all()  # no gradient at all
    for level in range(4):
        coherence = energy * 4**level / (energy * 4**level + 2e-5)
        seen = features[0, 16 + 2 * level : 18 + 2 * level, 8:-8, 8:-8]
        for channel, expected in zip(seen, double_angle, strict=True):
            np.testing.assert_allclose(channel, expected * coherence, atol=1e-3)
        log_energy = features[0, 24 + level, 8:-8, 8:-8]
        np.testing.assert_allclose(log_energy, (np.log(energy * 4**level + 1e-6) + 6) / 3, atol=1e-3)
