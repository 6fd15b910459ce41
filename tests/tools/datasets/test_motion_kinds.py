"""Photographs of four kinds of motion: each is what it says, the same for the same seed; its table counts."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tools.datasets.motion_kinds import KINDS, LEAST_PARALLAX, motion_scene, off_plane
from tools.datasets.testset import read_test_set

SIZE = (96, 72)


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_is_what_it_says(kind: str) -> None:
    scene = motion_scene(kind, 3, None, SIZE)
    deviation, length = off_plane(scene.displacement, scene.valid, scene.K)
    share = deviation.mean() / length.mean()
    assert scene.static.all()
    assert (scene.F is None) == (kind == "rotation" or not scene.t.any())
    if kind == "still":
        assert scene.median_px < 1
    else:
        assert 4 <= scene.median_px <= 60
        assert share < 0.01 if kind != "general" else share >= LEAST_PARALLAX


def test_command_writes_what_the_test_set_reads(tmp_path: Path, call_tool: Callable[[str], None]) -> None:
    call_tool(f"datasets.motion_kinds {tmp_path} --scenes 1 --size 96 72 --jobs 1")
    for kind in KINDS:
        (scene,) = read_test_set(tmp_path / kind)
        assert scene.image_path.exists() and scene.name == "20000"
        again = motion_scene(kind, 20_000, None, SIZE)  # the same seed, the same scene
        np.testing.assert_array_equal(scene.displacement, again.displacement)
        assert (scene.F is None) == (again.F is None)
