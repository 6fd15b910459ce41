"""Crops: picture and truth stay together through turns, mirrors, scales and workers."""

import numpy as np
import pytest

from tools.datasets.shards import Scenes, encode_linear
from tools.paper.crops import cut, orient

SIDE = 64


def coded_scenes(size: tuple[int, int] = (128, 96), count: int = 3) -> Scenes:
    """Make scenes whose radiance tells the truth: red = x, green = y of the displacement / 100 + 0.5."""
    rng = np.random.default_rng(0)
    rows, columns = size[1] // 4, size[0] // 4
    displacement = rng.uniform(-40, 40, (count, rows, columns, 2)).astype(np.float16)
    red_green = displacement.astype(np.float32).repeat(4, 1).repeat(4, 2) / 100 + 0.5
    linear = np.concatenate([red_green, np.full((*red_green.shape[:3], 1), 0.5)], -1)
    labels = rng.integers(0, 4, (count, rows, columns)).astype(np.uint8)
    return Scenes(linear=encode_linear(linear), displacement=displacement, labels=labels)


def decoded(linear: np.ndarray) -> np.ndarray:
    """Read the displacement at the cells' centres from the colours."""
    centres = linear[1::4, 1::4]
    return (centres[..., :2] - 0.5) * 100


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


def test_cut_picture_shows_its_own_truth() -> None:
    scenes, seen = coded_scenes(), set()
    for seed in range(30):
        linear, displacement, labels = cut(np.random.default_rng(seed), scenes, seed % 3, SIDE)
        assert (
            linear.shape == (SIDE, SIDE, 3) and displacement.shape == (16, 16, 2) and labels.shape == (16, 16)
        )
        source = np.isclose(decoded(linear), displacement, atol=0.05).all()
        seen.add(bool(source))
        if source:  # not resized: the cell's labels are those of the scene
            at = np.argwhere((scenes.displacement[seed % 3] == displacement[0, 0]).all(-1))[0]
            np.testing.assert_array_equal(labels, scenes.labels[seed % 3][at[0] :, at[1] :][:16, :16])
    assert seen == {True, False}
