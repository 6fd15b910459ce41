"""Smears in a file: the network's grid gives every pixel back; what is no such file."""

import os
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blur2view import load_smears
from blur2view.errors import OutputError
from blur2view.smears.grid import SmearGrid, stored_smears, to_double_angle


def grid(shape: tuple[int, int], stride: int = 32) -> SmearGrid:
    """Return smears up to 100 px in all directions, and sigmas, as a network's grid."""
    rng = np.random.default_rng(0)
    size = tuple(-(-side // stride) for side in shape)
    length, angle = rng.uniform(0, 100, size), rng.uniform(0, np.pi, size)
    smears = to_double_angle(length[..., None] * np.stack([np.cos(angle), np.sin(angle)], -1))
    cells = np.concatenate(
        [smears, rng.uniform(0.01, 1000, (*size, 1)), rng.uniform(0, 1.57, (*size, 1))], -1
    )
    return SmearGrid(cells=cells.astype(np.float32), stride=stride, shape=shape)


def written(path: Path, smears: SmearGrid) -> Path:
    """Write a file as the command does, with what was used of a photograph."""
    used = {"ends": np.zeros((3, 2, 2)), "second_end_is_open": np.zeros(3, bool)}
    with path.open("wb") as file:
        np.savez(file, **stored_smears(smears), **used)  # type: ignore[arg-type]
    return path


@pytest.mark.parametrize("shape", [(100, 130), (64, 96), (7, 5)])
def test_grid_gives_every_pixel_back_to_half_precision(tmp_path: Path, shape: tuple[int, int]) -> None:
    true = grid(shape)
    found = load_smears(written(tmp_path / "a.smear.npz", true))
    whole, read = true.at_pixels(), found.at_pixels()
    assert read.shape == whole.shape == shape
    for name in ("sigma_px", "sigma_rad"):
        np.testing.assert_allclose(getattr(read, name), getattr(whole, name), rtol=1e-3)
    # in double angle, for a smear and its opposite are one; as precise as the longest that was averaged
    vectors = (to_double_angle(field.displacement) for field in (read, whole))
    assert np.abs(np.subtract(*vectors)).max() < 100 * 2.0**-11


@pytest.mark.parametrize("damage", ["absent", "text", "cut", "other", "nan", "short", "stride", "pipe"])
def test_what_is_no_such_file_is_one_line(tmp_path: Path, damage: str) -> None:
    path = written(tmp_path / "a.smear.npz", grid((100, 130)))
    arrays: dict[str, Any] = dict(np.load(path))
    if damage == "absent":
        path.unlink()
    elif damage == "text":
        path.write_text("smears")
    elif damage == "pipe":
        path.unlink()
        os.mkfifo(path)
    elif damage == "cut":
        path.write_bytes(path.read_bytes()[:-100])
    else:
        arrays |= {
            "other": {"shape": np.array([1000, 1000])},
            "nan": {"smear_grid": np.full_like(arrays["smear_grid"], np.nan)},
            "short": {"shape": np.array(100)},
            "stride": {"stride": np.array(np.inf)},
        }[damage]
        np.savez(path, **arrays)
    remedy = "no such file" if damage == "absent" else "is not a whole .smear.npz file of blur2view"
    with pytest.raises(OutputError, match=rf"a\.smear\.npz: {remedy}; write it"):
        load_smears(path)


def test_small_file_of_many_zeros_is_refused_before_it_fills_the_memory(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "a.smear.npz", smear_grid=np.zeros((70_000, 1000), np.float32))
    tracemalloc.start()
    with pytest.raises(OutputError, match="whole"):
        load_smears(tmp_path / "a.smear.npz")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1 << 26
