"""Octaves of a photograph: how they are made, and how what is read in them is joined."""

import numpy as np

from blur2view.networks.octave_reader import joined, octaves


def test_each_octave_is_the_mean_of_two_by_two_pixels_of_the_one_before() -> None:
    grey = np.random.default_rng(0).random((64, 96), dtype=np.float32)
    numbers, pictures = zip(*octaves(grey, 3), strict=True)
    levels = pictures[::-1]
    assert numbers == (2, 1, 0) and [one.shape for one in levels] == [(64, 96), (32, 48), (16, 24)]
    assert levels[0] is grey
    for fine, coarse in zip(levels[:-1], levels[1:], strict=True):
        blocks = fine.reshape(coarse.shape[0], 2, coarse.shape[1], 2)
        np.testing.assert_allclose(coarse, blocks.mean((1, 3)), atol=1e-6)
        assert coarse.dtype == np.float32


def test_lengths_of_the_smaller_octave_are_joined_with_their_doubles_and_ends_stand_for_all_beyond() -> None:
    fine, coarse = np.zeros((1, 1, 32, 20), np.float32), np.zeros((1, 1, 32, 20), np.float32)
    fine[0, 0, 3, 9] = 1  # 8 px
    coarse[0, 0, 3, 5] = 1  # 4 px of the smaller picture
    joint = joined(fine, coarse)
    assert joint.shape == (1, 1, 32, 24) and joint[0, 0, 3, 9] == 2 == joint.sum()
    fine[..., -1] = 1  # anything longer
    coarse[..., 0] = 10  # anything shorter
    np.testing.assert_array_equal(joined(fine, coarse)[0, 0, 0], [10] * 5 + [0] * 14 + [1] * 5)
