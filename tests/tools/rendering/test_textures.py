"""Texture sources: disjoint splits, linear light, seeded generators."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tools.rendering import textures
from tools.rendering.textures import Image, photographs, split_files


def test_every_fourth_file_by_name_is_held_out(tmp_path: Path) -> None:
    for level, name in enumerate(["d.png", "a.jpg", "c.jpeg", "b.png", "e.png"]):
        assert cv2.imwrite(str(tmp_path / name), np.full((8, 8, 3), 10 * level, np.uint8))
    assert [p.name for p in split_files("test", tmp_path)] == ["d.png"]
    train, test = ({p.tobytes() for p in photographs(split, tmp_path)} for split in ("train", "test"))
    assert not train & test and len(train) == 7 + 4 and len(test) == 3 + 1


@pytest.mark.parametrize("maker", [one for one, _ in textures.PROCEDURAL], ids=lambda one: one.__name__)
def test_procedural_texture_is_a_varied_picture_of_its_seed(maker: Callable[..., Image]) -> None:
    first, again, other = (maker(np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first.shape == (textures.SIZE, textures.SIZE, 3) and first.dtype == np.float32
    assert first.min() > -0.5 and first.max() < 1.5 and first.std() > 0.01
    assert first.tobytes() == again.tobytes() != other.tobytes()
