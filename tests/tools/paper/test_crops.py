"""Crops: picture and truth stay together through turns, mirrors, scales and workers."""

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from tools.datasets.shards import Scenes, encode_linear
from tools.paper.crops import CropBatches, crop, cut, orient, resized

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


@pytest.mark.parametrize("source", [48, 92])
def test_resized_truth_grows_with_the_picture(source: int) -> None:
    cells = source // 4
    x = np.arange(cells, dtype=np.float32)
    displacement = np.stack(np.meshgrid(x, x), -1)  # tells its own cell
    linear = np.stack([*np.meshgrid(np.arange(source), np.arange(source)), np.zeros((source, source))], -1)
    labels = np.ones((cells, cells), np.uint8)
    picture, field, small = resized(linear.astype(np.float32), displacement, labels, SIDE)
    assert picture.shape == (SIDE, SIDE, 3) and field.shape == (16, 16, 2) and small.shape == (16, 16)
    scale = SIDE / source
    # the pixel at a target cell's centre shows source position p; its truth is that of the nearest cell
    shown = (picture[1::4, 1::4, :2] + picture[2::4, 2::4, :2]) / 2
    cell_centre = field / scale * 4 + 1.5
    assert np.abs(shown - cell_centre).max() <= 2.0 + 0.5 / scale + 0.1
    assert np.abs((shown - cell_centre).mean((0, 1))).max() < 0.5


def test_targets_are_finite_whatever_the_shards_hold_and_valid_by_the_first_bit() -> None:
    scenes = coded_scenes()
    for label, valid in enumerate((0, 1, 0, 1)):
        scenes.labels[:] = label
        image, target = crop(np.random.default_rng(1), scenes, 0, SIDE)
        assert (target[2] == valid).all() and np.abs(target[:2]).max() > 10
    assert image.dtype == target.dtype == np.float32 and image.min() >= 0 and image.max() <= 1
    assert image.shape == (3, SIDE, SIDE) and target.shape == (3, 16, 16)
    scenes.displacement[0, ::3] = np.inf
    scenes.displacement[0, 1::3, :, 0] = np.nan
    scenes.displacement[0, 2::3, :, 1] = 700
    for seed in range(4):
        assert not crop(np.random.default_rng(seed), scenes, 0, SIDE)[1].any()  # nothing here is usable


def test_batch_depends_only_on_seed_and_number_whoever_makes_it() -> None:
    batches, other = (CropBatches(coded_scenes(), seed=seed, batch=2, side=SIDE) for seed in (3, 4))
    made = list(DataLoader(batches, batch_size=None, sampler=range(3), num_workers=2))
    for k, (images, targets) in enumerate(made):
        assert torch.equal(images, batches[k][0]) and torch.equal(targets, batches[k][1])
    assert not torch.equal(made[0][0], made[1][0]) and not torch.equal(made[0][0], other[0][0])
