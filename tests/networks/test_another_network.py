"""A network of another architecture is one class: the pipeline asks it for no more than the protocol says."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from blur2view import SmearGrid, estimate, segment
from blur2view.arrays import AnyArray
from blur2view.networks.model_file import Execution
from blur2view.networks.smear_network import Detail
from blur2view.smears.grid import to_double_angle


class Oracle:
    """A network that knows the smears of a forward motion, whatever the picture."""

    model_id, execution = "oracle", Execution(threads=1)

    def predict(self, image: AnyArray, *, detail: Detail = Detail.GEOMETRY) -> SmearGrid:
        """Return smears that point away from the centre, a cell every 16 pixels, sure to 0.2 px."""
        height, width = image.shape[0] // 16, image.shape[1] // 16
        x, y = np.meshgrid(np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2)
        double = to_double_angle(np.stack([x, y], axis=-1))
        sigmas = np.full((height, width, 2), (0.2, 0.05))
        cells = np.concatenate([double, sigmas], axis=-1).astype(np.float32)
        shares, kinds = np.zeros((height, width, 64)), np.tile([0, 0, 0, 1, 0, 0], (height, width, 1))
        return SmearGrid(cells=cells, stride=16, shape=image.shape[:2], shares=shares, blur=kinds)


def test_an_estimate_takes_every_network_of_the_protocol() -> None:
    picture = np.random.default_rng(0).random((480, 640, 3), np.float32)  # one colour shows no blur
    found = estimate(picture, network=Oracle())
    assert found.model_id == "oracle" and found.geometry.F is not None
    epipole = np.linalg.svd(found.geometry.F)[2][-1]
    np.testing.assert_allclose(epipole[:2] / epipole[2], (319.5, 239.5), atol=3)


def test_what_lacks_part_of_the_protocol_is_refused_before_any_work() -> None:
    lacking: Any = SimpleNamespace(predict=None, execution=None)
    with pytest.raises(ValueError, match="must be a .*SmearReader, with predict, model_id and execution"):
        estimate(np.full((480, 640, 3), 0.5, np.float32), network=lacking)


def test_what_moves_is_segmented_whatever_the_cells_of_the_network() -> None:
    picture = np.random.default_rng(0).random((96, 128, 3), np.float32)
    mask = segment(estimate(picture, network=Oracle()), picture)
    assert mask.labels.shape == (96, 128)
