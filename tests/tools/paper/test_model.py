"""The network's shapes, what its stem measures, and its decoding."""

import numpy as np
import pytest
import torch

from blur2view.smears.field import to_double_angle
from tools.paper.model import ModelOptions, SmearUNet, decode
from tools.paper.stem import STRIDE, StructureStem

NARROW = ModelOptions(widths=(8, 12, 16), bottom=2)


@pytest.fixture(scope="module")
def network() -> SmearUNet:
    torch.manual_seed(0)
    return SmearUNet(NARROW).eval()


@pytest.mark.parametrize(("height", "width"), [(64, 64), (128, 192), (80, 48)])
def test_output_has_a_cell_per_stride(network: SmearUNet, height: int, width: int) -> None:
    with torch.no_grad():
        output = decode(network(torch.rand(2, 3, height, width)))
    assert output.shape == (2, 4, height // STRIDE, width // STRIDE)
    assert torch.isfinite(output).all() and (output[:, 2:] > 0).all()


def test_names_of_the_weights_stay_those_of_existing_checkpoints() -> None:
    names = SmearUNet(NARROW).state_dict()
    block = {"first.weight", "second.weight"} | {
        f"norms.{k}.{name}"
        for k in (0, 1)
        for name in ("weight", "bias", "running_mean", "running_var", "num_batches_tracked")
    }
    blocks = [f"encoders.{k}" for k in range(3)] + [
        f"{part}.{k}" for part in ("bottom", "decoders") for k in (0, 1)
    ]
    lifts = {f"lifts.{k}.{name}" for k in (0, 1) for name in ("weight", "bias")}
    assert set(names) == {f"{b}.{n}" for b in blocks for n in block} | lifts | {"head.weight", "head.bias"}


def test_untrained_network_expects_short_uncertain_smears() -> None:
    with torch.no_grad():
        head = SmearUNet(NARROW).head
        assert head.bias is not None
        output = decode(head.bias[None, :, None, None])
    assert output[0, 2].item() == pytest.approx(np.sqrt(2) * np.e, rel=1e-5)
    assert output[0, 3].item() == pytest.approx(np.sqrt(2) / np.e, rel=1e-5)
    assert decode(torch.tensor([1.0, 0, 2, 1, 0])[None, :, None, None])[0, 0].item() == pytest.approx(
        np.e**2 - 1, rel=1e-4
    )


def test_decoding_is_length_times_unit_double_angle() -> None:
    rng = np.random.default_rng(0)
    d = rng.normal(0, 10, (40, 2))
    unit = to_double_angle(d) / np.linalg.norm(d, axis=1, keepdims=True)
    any_scale = unit * rng.uniform(0.5, 20, (40, 1))
    raw = np.column_stack(
        [any_scale, np.log1p(np.linalg.norm(d, axis=1)), np.full(40, 0.7), np.full(40, -1.2)]
    )
    decoded = decode(torch.from_numpy(raw.T[None, :, :, None]))[0, :, :, 0].numpy().T
    np.testing.assert_allclose(decoded[:, :2], to_double_angle(d), atol=1e-5, rtol=3e-4)
    np.testing.assert_allclose(decoded[:, 2], np.sqrt(2) * np.exp(0.7))
    np.testing.assert_allclose(decoded[:, 3], np.sqrt(2) * np.exp(-1.2))


def test_decoding_bounds_length_and_sigma() -> None:
    raw = torch.tensor([[1.0, 0, 99, 99, 99], [1.0, 0, -99, -99, -99]])[..., None, None]
    decoded = decode(raw)[:, :, 0, 0]
    assert torch.isfinite(decoded).all()
    assert decoded[0, 0] == pytest.approx(np.exp(5.5) - 1, rel=1e-4)
    assert decoded[:, 2].numpy() == pytest.approx(np.sqrt(2) * np.exp([4.5, -3.0]))
    assert decoded[:, 3].numpy() == pytest.approx(np.sqrt(2) * np.exp([0.5, -5.0]))
    assert decoded[1, 0] == 0


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
