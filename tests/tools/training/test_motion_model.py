"""The motion segmentation network in torch: what is turned into the predicted direction, and what learns."""

from dataclasses import fields

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

from blur2view.segmentation.features import CHANNELS
from tools.training.motion_model import (
    DIRECTIONS,
    PAIRS,
    PLAIN,
    MotionOptions,
    MotionUNet,
    rolled,
    turned_angles,
    turned_directions,
)
from tools.training.stem import LEVELS, STRIDE, LagStem, OrientedStem, StructureStem

NARROW = MotionOptions(widths=(8, 8, 8, 8), bottom=1)
ENERGIES, DIRECTIONAL = 2 * LEVELS - 1, LagStem.channels + OrientedStem.channels


def frame_of(angle_deg: float) -> Tensor:
    """Give one cell (1, 2, 1, 1) whose predicted direction is this."""
    double = np.deg2rad(2 * angle_deg)
    return torch.tensor([np.cos(double), np.sin(double)], dtype=torch.float32)[None, :, None, None]


def scene(seed: int = 0, height: int = 96, width: int = 128) -> tuple[Tensor, Tensor]:
    """Give a photograph with texture of all directions, and features of smears that turn over it."""
    rng = np.random.default_rng(seed)
    image = cv2.GaussianBlur(rng.random((height, width, 3), dtype=np.float32), (0, 0), 1.0)
    features = rng.normal(0, 0.5, (CHANNELS, height // STRIDE, width // STRIDE)).astype(np.float32)
    predicted = cv2.GaussianBlur(np.ascontiguousarray(features[:2].transpose(1, 2, 0)), (0, 0), 2.0)
    features[:2] = (predicted / np.linalg.norm(predicted, axis=2, keepdims=True)).transpose(2, 0, 1) * 0.8
    return torch.from_numpy(image.transpose(2, 0, 1)[None].copy()), torch.from_numpy(features[None])


@pytest.fixture(scope="module")
def network() -> MotionUNet:
    torch.manual_seed(0)
    return MotionUNet(NARROW).eval()


def test_double_angles_are_turned_by_the_frame() -> None:
    for own_deg, frame_deg in ((0, 0), (30, 0), (30, 30), (170, 20), (-50, 80)):
        pairs = torch.cat([2 * frame_of(own_deg), 3 * frame_of(own_deg + 10)], 1)
        x1, x2, y1, y2 = turned_angles(pairs, frame_of(frame_deg)).flatten()  # first all x, then all y
        for x, y, length, more in ((x1, y1, 2, 0), (x2, y2, 3, 10)):
            expected = length * frame_of(own_deg + more - frame_deg).flatten()
            torch.testing.assert_close(torch.stack([x, y]), expected, atol=1e-5, rtol=0)


@pytest.mark.parametrize("steps", [-8, -4, -1, 0, 1, 3, 4, 7, 9])
def test_directions_are_read_from_the_frames_on(steps: int) -> None:
    values = torch.arange(16.0)[None, :, None, None]
    turned = turned_directions(values, frame_of(22.5 * steps)).flatten()
    first = [(k + steps) % 8 for k in range(8)]
    expected = torch.tensor([*first, *(8.0 + k for k in first)])
    torch.testing.assert_close(turned, expected, atol=1e-4, rtol=0)
    torch.testing.assert_close(turned, rolled(values, steps % 8).flatten(), atol=1e-4, rtol=0)


@pytest.mark.parametrize("angle_deg", [0.1, 10, 11.25, 22.4, 89.9, 95, 157.5, 179.9, -45.1])
def test_values_between_two_directions_are_interpolated(angle_deg: float) -> None:
    values = np.random.default_rng(0).normal(size=DIRECTIONS).astype(np.float32)
    turned = turned_directions(torch.from_numpy(values)[None, :, None, None], frame_of(angle_deg)).flatten()
    at = 22.5 * np.arange(DIRECTIONS)
    expected = np.interp((at + angle_deg) % 180, [*at, 180], [*values, values[0]])
    np.testing.assert_allclose(turned, expected, atol=1e-4)


def test_each_cell_is_turned_by_its_own_frame() -> None:
    values = torch.from_numpy(np.random.default_rng(1).normal(size=(2, 16, 3, 4)).astype(np.float32))
    _, features = scene(1, 12, 16)
    frame = torch.cat([features[:, :2], -features[:, :2]]) / 0.8
    for turn in (turned_angles, turned_directions):
        whole = turn(values, frame)
        one = turn(values[1:, :, 2:, 1:2], frame[1:, :, 2:, 1:2])
        torch.testing.assert_close(whole[1:, :, 2:, 1:2], one)


@pytest.mark.parametrize("angle_deg", [0.0, 22.5, 30.0, 67.5, 112.5, 160.0])
def test_blur_in_the_predicted_direction_looks_the_same_whichever_it_is(
    network: MotionUNet, angle_deg: float
) -> None:
    length, kernel = 16, np.zeros((33, 33), np.float32)
    along = 0.5 * length * np.array([np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))])
    ends = [tuple(np.rint((16 + sign * along) * 16).astype(int).tolist()) for sign in (-1, 1)]
    cv2.line(kernel, ends[0], ends[1], 1.0, 1, cv2.LINE_AA, 4)
    sharp = cv2.GaussianBlur(np.random.default_rng(0).random((192, 192), dtype=np.float32), (0, 0), 1.0)
    blurred = cv2.filter2D(sharp, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT)
    contrast = np.repeat(0.5 + 0.15 * (blurred - blurred.mean())[None, None] / blurred.std(), 3, axis=1)
    features = torch.zeros(1, CHANNELS, 48, 48)
    features[:, :2] = frame_of(angle_deg)
    with torch.no_grad():
        inputs = network.inputs(torch.from_numpy(contrast.astype(np.float32)), features)
    inside = inputs[0, PLAIN + ENERGIES :, 12:-12, 12:-12].mean((1, 2)).numpy()
    x, y = inside[: LEVELS - 1], inside[LEVELS : PAIRS - 1]  # the coarsest hardly sees it
    assert (x < -0.35).all() and (np.abs(y) < 0.25 * np.abs(x)).all()  # gradients run across the smear
    lags = inside[PAIRS : PAIRS + LagStem.channels].reshape(-1, DIRECTIONS)
    assert lags.argmin(0)[0] == 3 and lags[3].argmin() == 0  # 16 px on, along it, gradients are opposite
    fine = inside[PAIRS + LagStem.channels : PAIRS + DIRECTIONAL].reshape(-1, DIRECTIONS)
    assert (fine[:2].argmax(1) == DIRECTIONS // 2).all()  # detail is left across it


def test_turning_the_photograph_leaves_what_is_learned_from(network: MotionUNet) -> None:
    image, features = scene()
    turned = torch.rot90(features, 1, (2, 3)).clone()
    turned[:, :2] *= -1  # 90 degrees, doubled
    with torch.no_grad():
        expected = torch.rot90(network.inputs(image, features), 1, (2, 3))
        found = network.inputs(torch.rot90(image, 1, (2, 3)), turned)
    rest = found.shape[1] - PLAIN - ENERGIES - PAIRS - DIRECTIONAL
    parts = [PLAIN, ENERGIES, PAIRS, DIRECTIONAL, rest]
    for k, (mine, theirs) in enumerate(zip(found.split(parts, 1), expected.split(parts, 1), strict=True)):
        difference = (mine - theirs).abs()
        if k == 0:  # pixels within a cell change places
            continue
        if k == 3:  # a pair of pixels with an odd lag has no middle pixel
            assert difference.mean() < 0.15 * theirs.std()
        else:
            assert difference.max() < 1e-3
    same_frame = torch.rot90(features, 1, (2, 3))
    with torch.no_grad():
        wrong = network.inputs(torch.rot90(image, 1, (2, 3)), same_frame).split(parts, 1)
    assert (wrong[3] - expected.split(parts, 1)[3]).abs().mean() > 0.5 * expected.split(parts, 1)[3].std()


def test_where_no_direction_is_predicted_the_pictures_own_axes_stay(network: MotionUNet) -> None:
    image, features = scene(2)
    features[:, :2] = 0
    with torch.no_grad():
        stem, inputs = network.stem(image), network.inputs(image, features)
    start = PLAIN + PAIRS + ENERGIES
    pairs, directional = stem[:, PLAIN : PLAIN + PAIRS], stem[:, start:]
    torch.testing.assert_close(inputs[:, start : start + DIRECTIONAL], directional)
    torch.testing.assert_close(
        inputs[:, PLAIN + ENERGIES : start], torch.cat([pairs[:, ::2], pairs[:, 1::2]], 1)
    )
    assert torch.isfinite(inputs).all() and inputs[:, start + DIRECTIONAL + 3].max() < 1e-3


def test_inputs_hold_colours_sharpness_and_features_as_they_are(network: MotionUNet) -> None:
    image, features = scene(3)
    with torch.no_grad():
        inputs = network.inputs(image, features)
    assert inputs.shape[1] == StructureStem.channels + 3 + CHANNELS - 1
    colour, sharpness, rest = inputs[:, StructureStem.channels :].split([3, 1, CHANNELS - 2], 1)
    torch.testing.assert_close(rest, features[:, 2:], rtol=0, atol=0)
    torch.testing.assert_close(sharpness, torch.full_like(sharpness, 0.8))
    torch.testing.assert_close(colour[0, :, 5, 7], image[0, :, 20:24, 28:32].mean((1, 2)))


def test_inputs_have_no_parameters_and_all_parameters_learn(network: MotionUNet) -> None:
    image, features = scene(4, 64, 64)
    torch.manual_seed(1)
    other = MotionUNet(NARROW)
    assert not list(other.stem.parameters())
    torch.testing.assert_close(other.inputs(image, features), network.inputs(image, features), rtol=0, atol=0)
    assert not other.inputs(image, features).requires_grad
    torch.autograd.backward(other(image, features).square().mean())
    for name, parameter in other.named_parameters():
        assert parameter.grad is not None and parameter.grad.abs().max() > 0, name


@pytest.mark.parametrize("size", [(32, 32), (32, 96), (96, 64)])
def test_there_is_a_logit_for_every_cell(network: MotionUNet, size: tuple[int, int]) -> None:
    image, features = scene(5, *size)
    with torch.no_grad():
        logits = network(torch.cat([image, image]), torch.cat([features, features]))
    assert logits.shape == (2, 1, size[0] // STRIDE, size[1] // STRIDE)
    assert torch.equal(logits[0], logits[1]) and torch.isfinite(logits).all()


def test_sides_that_are_no_multiples_are_refused_by_the_network(network: MotionUNet) -> None:
    step = MotionUNet.multiple_of
    assert step == STRIDE * 2 ** (len(NARROW.widths) - 1)
    with pytest.raises(RuntimeError), torch.no_grad():
        network(*scene(6, step + step // 2, step))


def test_options_survive_a_checkpoint() -> None:
    assert MotionOptions(**NARROW.as_dict()) == NARROW
    assert set(NARROW.as_dict()) == {field.name for field in fields(MotionOptions)}
    deep = MotionUNet(MotionOptions(widths=(8, 12), bottom=3))
    assert len(deep.bottom) == 3 and len(deep.encoders) == 2 and len(deep.decoders) == 1
