"""A look at a photograph: as many windows for any size, and the smears of all windows."""

from unittest.mock import Mock

import cv2
import numpy as np
import pytest

from blur2view.networks.look import CELLS, first_octave, window_stride
from blur2view.networks.octaves import UNSEEN_SIGMA_PX
from blur2view.networks.smear_network import Detail, SmearNetwork
from tests.networks.test_smear_network import smeared_photograph

SIZES = (480, 640), (640, 416), (1080, 1920), (2160, 3840), (3000, 4000), (300, 50), (16, 17)


@pytest.mark.parametrize(("height", "width"), SIZES)
def test_windows_are_as_many_for_every_size(height: int, width: int) -> None:
    stride = window_stride(height, width)
    cells = -(-height // stride) * -(-width // stride)
    assert 0 < cells <= 1.3 * CELLS
    assert cells >= 0.7 * CELLS or stride == 32
    first = first_octave(height, width)
    assert first == 0 or max(height, width) / 2**first >= 240


@pytest.mark.parametrize(("length", "octaves_read"), [(2.0, 3), (8.0, 3), (40.0, 2)])
def test_finer_octaves_are_read_while_the_smears_may_be_short(
    monkeypatch: pytest.MonkeyPatch, length: float, octaves_read: int
) -> None:
    image = cv2.resize(smeared_photograph(length, 32.0), (1000, 666), interpolation=cv2.INTER_CUBIC)
    network = SmearNetwork()
    run = Mock(wraps=network._network.run)
    monkeypatch.setattr(network._network, "run", run)
    grid = network.predict(np.rint(255 * image.clip(0, 1)).astype(np.uint8), detail=Detail.RANKING)
    assert run.call_count == octaves_read
    assert grid.shape == (666, 1000) and grid.shares is None
    assert np.median(grid.smears().length_px) == pytest.approx(length * 1000 / 600, rel=0.15)


@pytest.mark.parametrize("white", [255, 65535, 1])
def test_pixels_of_every_depth_show_the_same(white: int) -> None:
    image, network = smeared_photograph(8.0, 32.0), SmearNetwork()
    wanted = np.median(network.predict(image, detail=Detail.GEOMETRY).smears().length_px)
    if white > 1:
        image = np.rint(white * image).astype(np.uint8 if white == 255 else np.uint16)
    seen = network.predict(image, detail=Detail.RANKING)
    assert np.median(seen.smears().length_px) == pytest.approx(wanted, rel=0.05)


def test_cells_without_texture_show_nothing_and_the_others_do() -> None:
    image = np.rint(255 * smeared_photograph(8.0, 32.0)).astype(np.uint8)
    image[:, :300] = 200
    sigma_px = SmearNetwork().predict(image, detail=Detail.RANKING).sigma_px
    np.testing.assert_array_equal(sigma_px[:, 0], UNSEEN_SIGMA_PX)
    assert (sigma_px[:, -2] < 10).all()


@pytest.mark.parametrize(
    ("height", "width", "cells"), [(16, 16, (1, 1)), (20, 300, (1, 10)), (600, 25, (19, 1))]
)
def test_small_photographs_and_strips_are_read_in_the_cells_that_they_have(
    height: int, width: int, cells: tuple[int, int]
) -> None:
    image = np.random.default_rng(0).integers(0, 256, (height, width), np.uint8)
    grid = SmearNetwork().predict(image, detail=Detail.RANKING)
    assert grid.shape == (height, width) and grid.cells.shape[:2] == cells
