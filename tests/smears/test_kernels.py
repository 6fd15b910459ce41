"""Blur kernels and blur maps, read off photographs blurred by kernels that are known."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from blur2view.arrays import AnyArray, Floats
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import Estimate, estimate
from blur2view.smears.blur import Blur, BlurKind
from blur2view.smears.blur_map import BlurLabel, blur_map, label_shares
from blur2view.smears.grid import SmearGrid
from blur2view.smears.kernels import blur_kernels, disc, motion_kernels

SIDE = 41
Blurred = Callable[[Floats], Estimate]


@pytest.fixture(scope="module")
def sharp() -> Floats:
    """Return a sharp picture in linear light: discs of all sizes, each before those drawn earlier."""
    rng, picture = np.random.default_rng(0), np.full((320, 480), 0.4, np.float32)
    for _ in range(6000):
        centre = (int(rng.integers(480)), int(rng.integers(320)))
        cv2.circle(picture, centre, int(2 + 20 * rng.random() ** 4), float(rng.uniform(0.02, 0.9)), -1)
    return picture


@pytest.fixture(scope="module")
def blurred(sharp: Floats) -> Blurred:
    """Return a function that blurs the picture by a kernel, and estimates it."""
    network = SmearNetwork()

    def run(kernel: Floats) -> Estimate:
        light = cv2.filter2D(sharp, -1, kernel) + np.random.default_rng(0).normal(0, 0.002, sharp.shape)
        return estimate(coded(light), network=network)

    return run


def coded(light: AnyArray) -> AnyArray:
    """Return linear light as an sRGB-like picture of 8 bits."""
    return np.rint(255 * np.clip(light, 0, 1) ** (1 / 2.2)).astype(np.uint8)


def padded(kernel: Floats) -> Floats:
    """Return a kernel in the middle of SIDE x SIDE pixels."""
    margin = (SIDE - len(kernel)) // 2
    return np.pad(kernel, margin) if margin >= 0 else kernel[-margin:margin, -margin:margin]


def likeness(kernel1: Floats, kernel2: Floats) -> float:
    """Return the cosine between two kernels."""
    return float((kernel1 * kernel2).sum() / np.sqrt((kernel1**2).sum() * (kernel2**2).sum()))


@pytest.mark.parametrize(("length", "angle_deg", "radius"), [(16, 30, 0.0), (22, 110, 0.0), (0, 0, 4.0)])
def test_kernel_is_the_one_that_blurred_the_photograph(
    blurred: Blurred, length: float, angle_deg: float, radius: float
) -> None:
    angle = np.deg2rad(angle_deg)
    smear = length * np.array([[np.cos(angle), np.sin(angle)]])
    (true,) = motion_kernels(smear, np.array([radius]), SIDE)
    found = blurred(true)
    kernels = blur_kernels(found.grid, found.blur)
    assert likeness(padded(kernels.whole), true) > 0.95
    assert kernels.whole.sum() == pytest.approx(1, abs=1e-5)
    of_cells = [likeness(padded(cell.astype(np.float32)), true) for cell in kernels.cells[kernels.known]]
    assert np.median(of_cells) > 0.9
    # reversed time is the same blur
    assert np.allclose(kernels.whole, kernels.whole[::-1, ::-1], atol=1e-6)


def test_line_has_the_length_and_direction_of_its_smear() -> None:
    (kernel,) = motion_kernels(np.array([[12.0, 9.0]]), np.zeros(1), SIDE)
    y, x = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2
    variance = 15**2 / 12  # of an even line of 15 px
    assert kernel.sum() == pytest.approx(1, abs=1e-6)
    assert (kernel * x * y).sum() == pytest.approx(variance * 0.8 * 0.6, rel=0.02)
    assert (kernel * (x * x + y * y)).sum() == pytest.approx(variance + 1 / 3, rel=0.03)  # of interpolation


def test_disc_spreads_as_its_radius_says() -> None:
    kernel = disc(5.0)
    x = np.arange(len(kernel)) - len(kernel) // 2
    assert (kernel * x**2).sum() == pytest.approx(5**2 / 4 + 1 / 12, rel=0.01)


def test_kernels_and_maps_need_kinds_of_blur() -> None:
    grid = SmearGrid(cells=np.zeros((2, 3, 4), np.float32), stride=32, shape=(64, 96))
    with pytest.raises(ValueError, match="kinds of blur"):
        blur_kernels(grid, Blur(kind=BlurKind.SHARP))
    with pytest.raises(ValueError, match="kinds of blur"):
        blur_map(grid)


def test_map_tells_a_sharp_half_from_a_smeared_and_a_soft_one(sharp: Floats) -> None:
    smear, soft = motion_kernels(np.array([[20.0, 0.0], [0.0, 0.0]]), np.array([0.0, 5.0]), SIDE)
    light = np.hstack([cv2.filter2D(sharp, -1, smear), sharp, cv2.filter2D(sharp, -1, soft)])
    labels = blur_map(SmearNetwork().predict(coded(light)))
    thirds = [labels[:, 48 + 480 * k : 480 * (k + 1) - 48] for k in range(3)]
    for third, label in zip(thirds, (BlurLabel.SMEARED, BlurLabel.SHARP, BlurLabel.SOFT), strict=True):
        assert (third == label).mean() > 0.9
    assert sum(label_shares(labels).values()) == pytest.approx(1)


def test_kernel_leaves_out_what_a_longer_smear_covers_beyond_it() -> None:
    long, short = motion_kernels(np.array([[400.0, 100.0], [40.0, 10.0]]), np.zeros(2), 41)
    np.testing.assert_allclose(long, short, atol=0.01)
