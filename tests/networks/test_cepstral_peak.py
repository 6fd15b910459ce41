"""Smears are moved to the peak of the cepstrum where there is one, and left alone elsewhere."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from blur2view.networks.cepstral_peak import refine_on_cepstrum
from blur2view.networks.octaves import octaves
from blur2view.networks.spectra import polar_cepstra, power_spectra, sliding_windows
from blur2view.smears.grid import from_double_angle, to_double_angle

Floats = NDArray[np.float32]
SIDE = 256


def blurred(length_px: float, angle_deg: float, seed: int = 0) -> Floats:
    """Return a picture of random blobs under one even smear, grey in [0, 1], with noise of half a level."""
    rng = np.random.default_rng(seed)
    size = SIDE + 128, SIDE + 128
    blobs = [cv2.GaussianBlur(rng.normal(0, s, size), (0, 0), s) for s in (0.8, 2.0, 6.0)]
    sharp = np.sum(blobs, axis=0)
    along = np.linspace(-0.5, 0.5, 2 * int(length_px)) * length_px
    x, y = np.outer(unit(angle_deg), along)
    shifts = [np.array([[1, 0, u], [0, 1, v]], float) for u, v in zip(x, y, strict=True)]
    mean = np.mean([cv2.warpAffine(sharp, m, size, flags=cv2.INTER_CUBIC) for m in shifts], axis=0)
    grey = 0.5 + 0.12 * mean[64:-64, 64:-64] / mean.std() + rng.normal(0, 0.002, (SIDE, SIDE))
    return np.asarray(np.clip(grey, 0, 1), np.float32)


def refined(cells: Floats, picture: Floats, count: int = 1) -> Floats:
    """Return smears refined on so many octaves of a picture."""
    spectra = [power_spectra(sliding_windows(one)) for _, one in octaves(picture, count)]
    return refine_on_cepstrum(cells, spectra[::-1])


def unit(angle_deg: float) -> NDArray[np.float64]:
    """Return the unit vector of a direction."""
    return np.array([np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))])


def cells_of(length_px: float, angle_deg: float, sigma_px: float = 3.0, sigma_deg: float = 5.0) -> Floats:
    """Return a network's answer: the same smear in every cell."""
    cell = [*to_double_angle(length_px * unit(angle_deg)), sigma_px, np.deg2rad(sigma_deg)]
    return np.tile(np.array(cell, np.float32), (SIDE // 32, SIDE // 32, 1))


def errors(cells: Floats, length_px: float, angle_deg: float) -> tuple[float, float]:
    """Return the median ratio of lengths, less one, and the median error of directions, degrees; absolute."""
    d = from_double_angle(cells[..., :2])
    angle = np.degrees(np.arctan2(d[..., 1], d[..., 0])) - angle_deg
    ratio = np.hypot(d[..., 0], d[..., 1]) / length_px - 1
    return float(np.median(abs(ratio))), float(np.median(abs((angle + 90) % 180 - 90)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("length_px", "angle_deg", "count"),
    [(18, 20, 3), (22.3, 97, 3), (27, -40, 3), (44, 65, 3), (80, 178, 3), (34, 30, 1)],
)
def test_smears_are_moved_to_the_peak(length_px: float, angle_deg: float, count: int) -> None:
    given = cells_of(1.1 * length_px, angle_deg + 5, sigma_px=0.15 * length_px)
    copy = given.copy()
    moved = refined(given, blurred(length_px, angle_deg), count)
    np.testing.assert_array_equal(given, copy)
    ratio, error_deg = errors(moved, length_px, angle_deg)
    assert ratio < 0.02 and error_deg < 0.8
    assert np.median(moved[..., 2]) < 0.5 * given[0, 0, 2]
    assert np.median(moved[..., 3]) < 0.5 * given[0, 0, 3]


@pytest.mark.slow
def test_stated_deviations_hold_the_errors() -> None:
    """Of 10 pictures, networks err by what they state, and moved smears by a third of that, and state it."""
    rows = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        length, angle = rng.uniform(15, 27), rng.uniform(-90, 90)
        scale, turn = np.exp(rng.normal(0, 0.1)), rng.normal(0, 5)
        given = cells_of(length * scale, angle + turn, sigma_px=0.13 * length)
        moved = refined(given, blurred(length, angle, seed))[4, 4]
        ratio, error_deg = errors(moved[None, None], length, angle)
        rows.append((np.deg2rad(error_deg) / moved[3], ratio * length / moved[2], moved[2] / given[4, 4, 2]))
    turns, scales, shrunk = np.array(rows).T
    assert all(0.2 < np.sqrt(np.mean(one**2)) < 1.5 for one in (turns, scales))
    assert np.median(shrunk) < 1 / 3


def test_the_second_peak_at_twice_the_smear_confirms_nothing() -> None:
    given = cells_of(40, 30, sigma_px=20, sigma_deg=5)
    right, twice = (refined(given, blurred(px, 30), 2) for px in (40, 20))
    assert np.median(right[..., 2]) < 0.2 * 20
    assert np.median(twice[..., 2]) > 0.8 * 20


@pytest.mark.parametrize("spread", [0.0, 1.0])
def test_without_a_peak_the_network_is_believed(spread: float) -> None:
    """White noise and a constant have no peak: smears move by less than their deviation."""
    noise = (
        np.random.default_rng(0).uniform(0.5 - spread / 2, 0.5 + spread / 2, (SIDE, SIDE)).astype(np.float32)
    )
    given = cells_of(20, 30, sigma_px=2.0, sigma_deg=4.0)
    moved = refined(given, noise)
    ratio, angle_deg = errors(moved, 20, 30)
    assert np.isfinite(moved).all() and ratio < 0.1 and angle_deg < 4
    assert np.median(moved[..., 2]) > 0.5 * 2.0


def test_cepstra_of_a_mirrored_window_are_mirrored() -> None:
    window = blurred(12.0, 25.0)[:96, :96]
    same, down, across = (
        polar_cepstra(power_spectra(np.ascontiguousarray(one)[None, None]))[0][0, 0]
        for one in (window, window[::-1], window.T)
    )
    bins = np.arange(32)  # of 180 / 32 degrees
    assert same.std() > 0.9
    np.testing.assert_allclose(down, same[-bins % 32], atol=5e-3)
    np.testing.assert_allclose(across, same[(16 - bins) % 32], atol=5e-3)


def test_windows_are_centred_on_their_cells() -> None:
    x, y = np.meshgrid(np.arange(256.0), np.arange(224.0))
    middles = [sliding_windows(one)[1:-1, 1:-1].mean((2, 3)) for one in (x, y)]
    expected = np.meshgrid(32 * np.arange(1, 7) + 15.5, 32 * np.arange(1, 6) + 15.5)
    np.testing.assert_allclose(middles, expected)
