"""Which photographs are kept by their blur: the sharpest, one of each few neighbours, every view."""

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.images.selection import same_view, sharpest_of_each, thumbnail


def pictures(seed: int, count: int) -> list[Array]:
    """Return thumbnails of a walk past one scene, each shifted by 1.5 % of the width."""
    rng = np.random.default_rng(seed)
    scene = np.repeat(np.repeat(rng.random((12, 40, 3)), 40, 0), 40, 1).astype(np.float32)
    return [thumbnail(scene[:, 10 * k : 10 * k + 640]) for k in range(count)]


def test_a_view_is_told_from_others_though_it_shifts() -> None:
    first, other = pictures(0, 6), pictures(1, 6)
    assert all(same_view(first[0], one) for one in first)
    assert not any(same_view(first[k], other[k]) for k in range(6))
    assert not same_view(first[0], None) and not same_view(first[0], first[0][:-1])
    flat = np.zeros_like(first[0])
    assert not same_view(flat, first[0])


@pytest.mark.parametrize("size", [1, 2, 3, 6])
def test_one_of_every_few_neighbours_is_kept(size: int) -> None:
    views = pictures(0, 6)
    lengths = [5.0, 1.0, 3.0, 4.0, 2.0, 6.0]
    kept = sharpest_of_each(lengths, ["a"] * 6, size, views.__getitem__)
    assert kept == {1: set(range(6)), 2: {1, 2, 4}, 3: {1, 4}, 6: {1}}[size]


def test_the_only_photograph_of_a_view_is_kept_however_blurred() -> None:
    views = [*pictures(0, 3), *pictures(1, 1), *pictures(0, 2)]
    kept = sharpest_of_each([1.0, 2.0, 3.0, 40.0, 5.0, 6.0], ["a"] * 6, 6, views.__getitem__)
    assert kept == {0, 3}
    lost = sharpest_of_each([1.0, 2.0], ["a"] * 2, 6, lambda one: None)  # whose pictures are gone
    assert lost == {0, 1}


def test_what_shows_no_texture_is_kept_only_where_nothing_else_is() -> None:
    dark = np.zeros((72, 96))
    assert sharpest_of_each([None, 3.0, None, None], ["a"] * 4, 2, lambda one: dark) == {1, 2}


def test_ten_frames_of_a_still_view_are_one_view() -> None:
    rng = np.random.default_rng(1)
    scene = np.cumsum(np.cumsum(rng.normal(size=(240, 320, 3)), 0), 1)  # like a photograph, of 1 / f
    scene = 0.5 + 0.1 * (scene - scene.mean()) / scene.std()
    frames = [np.clip(scene + rng.normal(0, 0.03, scene.shape), 0, 1).astype(np.float32) for _ in range(10)]
    views = [thumbnail(frame) for frame in frames]
    lengths = rng.uniform(1, 2, 10).tolist()
    assert sharpest_of_each(lengths, ["a"] * 10, 10, views.__getitem__) == {int(np.argmin(lengths))}
