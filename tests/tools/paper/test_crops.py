"""Crops: picture and truth stay together through turns, mirrors, scales and workers."""

import numpy as np
import pytest

from tools.paper.paper_variants import orient


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("turns", range(4))
def test_displaced_dot_stays_displaced_by_the_truth(turns: int, mirror: bool) -> None:
    start, d = np.array([9, 20]), np.array([12, -5])
    picture, field = np.zeros((32, 40, 2), np.float32), np.broadcast_to(d, (8, 10, 2)).astype(np.float32)
    picture[start[1], start[0], 0] = 1
    picture[start[1] + d[1], start[0] + d[0], 1] = 1
    labels = np.arange(80).reshape(8, 10)
    image, displacement, turned = orient(picture, field, labels, turns, mirror)
    dots = [np.argwhere(image[..., k] == 1)[0][::-1] for k in (0, 1)]
    np.testing.assert_array_equal(displacement[3, 3], dots[1] - dots[0])
    assert (displacement == displacement[0, 0]).all()
    # labels follow the picture: the cell of the first dot
    assert turned[dots[0][1] // 4, dots[0][0] // 4] == labels[start[1] // 4, start[0] // 4]
