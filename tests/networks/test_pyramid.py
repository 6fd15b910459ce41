"""Long smears from smaller copies: when, how they are blended, and that short ones are left alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray

from blur2view.errors import ModelError
from blur2view.networks.pyramid import PyramidOptions, blended, halved
from blur2view.networks.smear_network import SmearNetwork
from blur2view.networks.tiles import TileOptions
from tests.support.colour_code import colour_code, colour_code_network

LONGEST_PX = 16.0


def grid_of(length: float, shape: tuple[int, int], sigma: float = 1.0) -> NDArray[np.float32]:
    """Give a grid of equal smears at 45 degrees, whose double angle points along y."""
    return np.broadcast_to(np.array([0, length, sigma], np.float32), (*shape, 3)).copy()


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> SmearNetwork:
    """Give the network that reads smears from colours: in a halved copy, too, it sees the painted lengths."""
    path = tmp_path_factory.mktemp("model") / "reach.onnx"
    onnx.save(colour_code_network(longest_px=str(LONGEST_PX)), path)
    return SmearNetwork(path)


def painted(length: float, size: tuple[int, int] = (256, 320)) -> NDArray[np.float32]:
    """Paint smears of one length and of sigma 1 that turn slowly."""
    phi = np.mgrid[: size[0], : size[1]].sum(0) * 0.004
    return colour_code(length * np.stack([np.cos(phi), np.sin(phi)], -1), 1.0)


def with_direction(grid: NDArray[np.float32], sigma_rad: float) -> NDArray[np.float32]:
    return np.dstack([grid, np.full(grid.shape[:2], sigma_rad, np.float32)])


def test_length_is_the_images_own_up_to_half_the_reach_and_the_copys_from_it_on() -> None:
    fine = grid_of(5, (6, 8))
    for coarse, length, sigma in (
        (3, 5, 1),
        (4, 5, 1),
        (8 / 2**0.5, (5 * 2 * 8 / 2**0.5) ** 0.5, 3.5),
        (8, 16, 6),
    ):
        mixed = blended(fine, grid_of(coarse, (3, 4), sigma=3.0), LONGEST_PX)
        np.testing.assert_allclose(mixed, grid_of(length, (6, 8), sigma), rtol=2e-3, atol=1e-5)


@pytest.mark.parametrize(("mine", "theirs", "share"), [(0.1, 0.1, 0.5), (0.2, 0.1, 0.8), (0.1, 0.3, 0.1)])
def test_directions_are_averaged_by_their_certainty(mine: float, theirs: float, share: float) -> None:
    down, right = grid_of(5, (6, 8)), grid_of(1, (3, 4))[..., [1, 0, 2]]  # a quarter of a turn apart, doubled
    mixed = blended(with_direction(down, mine), with_direction(right, theirs), LONGEST_PX)
    expected = np.array([share, 1 - share]) * 5 / np.hypot(share, 1 - share)
    np.testing.assert_allclose(mixed[..., :2], np.broadcast_to(expected, (6, 8, 2)), rtol=1e-4)
    np.testing.assert_allclose(mixed[..., 2], 1, rtol=1e-5)
    np.testing.assert_allclose(mixed[..., 3], mine + share * (theirs - mine), rtol=1e-4)


@pytest.mark.parametrize(("theirs", "sign"), [(0.1001, 1), (0.0999, -1)])
def test_directions_that_cancel_leave_the_surer_one(theirs: float, sign: int) -> None:
    mine, other = grid_of(5, (6, 8)), grid_of(-1, (3, 4))
    mixed = blended(with_direction(mine, 0.1), with_direction(other, theirs), LONGEST_PX)
    np.testing.assert_allclose(mixed[..., 1], sign * 5, rtol=1e-3)


@pytest.mark.parametrize("shape", [(5, 8), (6, 7), (5, 5)])
def test_grid_of_odd_size_continues_at_its_border(shape: tuple[int, int]) -> None:
    mixed = blended(grid_of(1, shape), grid_of(20, (shape[0] // 2, shape[1] // 2)), LONGEST_PX)
    np.testing.assert_allclose(mixed, grid_of(40, shape, sigma=2.0), rtol=1e-4)


def test_halving_averages_blocks() -> None:
    image = np.random.default_rng(0).random((7, 10, 3), dtype=np.float32)
    expected = image[:6].reshape(3, 2, 5, 2, 3).mean((1, 3))
    np.testing.assert_allclose(halved(image), expected, rtol=1e-5)


def test_place_is_kept() -> None:
    x = np.arange(16, dtype=np.float32) * 4 + 1.5  # centres of cells
    ramp = np.dstack([np.zeros((16, 16)), np.broadcast_to(x, (16, 16)), np.ones((16, 16))]).astype(np.float32)
    coarse = np.asarray((ramp[::2, ::2] + ramp[1::2, 1::2]) / 2 / 2, np.float32)  # in its own, double pixels
    mixed = blended(0.5 * ramp, coarse, 1e-3)
    np.testing.assert_allclose(mixed[:, 1:-1, 1], ramp[:, 1:-1, 1], rtol=1e-4)


@pytest.mark.parametrize(("levels", "seen"), [(1, 12), (2, 24), (3, 48)])
def test_long_smears_come_from_the_smallest_copies(network: SmearNetwork, levels: int, seen: float) -> None:
    found = network.predict(painted(12.0, (400, 400)), pyramid=PyramidOptions(levels=levels))
    np.testing.assert_allclose(
        found.length_px, seen, rtol=1e-2
    )  # every copy shows this network the same colours


def test_short_smears_keep_their_length(network: SmearNetwork) -> None:
    found = network.predict(painted(4.0), pyramid=PyramidOptions(levels=2))
    np.testing.assert_allclose(found.length_px, 4, rtol=1e-2)


def test_smaller_copies_are_looked_at_only_where_they_may_help(network: SmearNetwork) -> None:
    long = grid_of(12, (10, 10))
    few = grid_of(1, (10, 10))
    few[0, :2] = long[0, 0]
    options = PyramidOptions(long_share=0.02)
    for level, shape, grid, wanted in (
        (0, (192, 300, 3), few, True),
        (0, (191, 300, 3), long, False),  # too small
        (1, (192, 300, 3), few, True),
        (2, (900, 900, 3), long, True),
        (3, (900, 900, 3), long, False),  # deep enough
    ):
        assert options.halves(level, shape, grid, LONGEST_PX) == wanted
    pickier = replace(options, long_share=0.03)
    assert pickier.halves(0, (192, 300, 3), few, LONGEST_PX)  # the first copy is always looked at
    assert not pickier.halves(1, (192, 300, 3), few, LONGEST_PX)


def test_tiles_and_copies_go_together(network: SmearNetwork) -> None:
    tiling = TileOptions(max_pixels=1, tile_px=128, overlap_px=64)
    found = network.predict(painted(12.0, (300, 420)), tiling, PyramidOptions(levels=2)).length_px
    np.testing.assert_allclose(found, 24, rtol=1e-2)


def test_network_that_does_not_tell_its_reach_sees_only_the_photograph(tiny_model: Path) -> None:
    assert SmearNetwork(tiny_model).info.longest_px is None
    np.testing.assert_allclose(SmearNetwork(tiny_model).predict(painted(40.0)).length_px, 40, rtol=5e-3)


@pytest.mark.parametrize("values", [{"levels": 0}, {"long_share": 1.5}, {"smallest_px": 1}])
def test_pyramid_that_cannot_work_is_refused(values: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected levels"):
        PyramidOptions(**values)  # type: ignore[arg-type]


@pytest.mark.parametrize("reach", ["0", "-3", "nan", "far"])
def test_reach_that_cannot_be_is_refused(tmp_path: Path, reach: str) -> None:
    onnx.save(colour_code_network(longest_px=reach), tmp_path / "odd.onnx")
    with pytest.raises(ModelError, match="damaged metadata"):
        SmearNetwork(tmp_path / "odd.onnx")
