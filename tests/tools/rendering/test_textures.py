"""Texture sources: disjoint splits."""

from pathlib import Path

import cv2
import numpy as np

from tools.rendering.textures import photographs, split_files


def test_every_fourth_file_by_name_is_held_out(tmp_path: Path) -> None:
    for level, name in enumerate(["d.png", "a.jpg", "c.jpeg", "b.png", "e.png"]):
        assert cv2.imwrite(str(tmp_path / name), np.full((8, 8, 3), 10 * level, np.uint8))
    assert [p.name for p in split_files("test", tmp_path)] == ["d.png"]
    train, test = ({p.tobytes() for p in photographs(split, tmp_path)} for split in ("train", "test"))
    assert not train & test and len(train) == 7 + 4 and len(test) == 3 + 1
