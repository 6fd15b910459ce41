"""Exposures of a dataset, written in the formats of our own test split and training shards."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray
from blur2view.errors import Blur2ViewError
from blur2view.output_files import write_atomically
from tools.datasets.exposure import Exposure
from tools.datasets.shards import Scenes, encode_linear
from tools.rendering.exposure import GRID, grid_points

SHARD = 50
"""Exposures in one file."""


def cropped(exposure: Exposure) -> tuple[int, int]:
    """Return the width and height that are kept: multiples of the grid's spacing."""
    height, width = exposure.linear.shape[:2]
    return width // GRID * GRID, height // GRID * GRID


def grid_truth(exposure: Exposure) -> tuple[AnyArray, NDArray[np.bool_]]:
    """Return displacement (h, w, 2), float32, and validity (h, w) at the centres of the 4 x 4 cells.

    A cell is valid if the four pixels about its centre are, and agree to a pixel: else it is cut by an edge.
    """
    smears, points = exposure.smears, grid_points(cropped(exposure)).astype(int)
    four = [points + np.array(step) for step in ((0, 0), (1, 0), (0, 1), (1, 1))]
    displacement = np.stack([smears.displacement[at[..., 1], at[..., 0]] for at in four])
    valid = np.all([smears.valid[at[..., 1], at[..., 0]] for at in four], axis=0)
    spread = np.linalg.norm(displacement - displacement.mean(axis=0), axis=-1).max(axis=0)
    return displacement.mean(axis=0).astype(np.float32), valid & (spread < 1)


def write_test_scenes(exposures: Iterable[Exposure], out: Path, source: str) -> int:
    """Write what `testset.read_test_set` reads; finished ones are kept. Return their number.

    ``origins.txt`` says which exposure of the source each number is, as every file does itself. Without
    cameras R and t are NaN and K is a guess. Blur2ViewError if the folder holds another exposure under a
    number, or a file that is no scene.
    """
    out.mkdir(parents=True, exist_ok=True)
    count, names = 0, []
    for count, exposure in enumerate(exposures, 1):
        stem, origin = out / f"{count - 1:04d}", f"{source} {exposure.name}"
        names.append(f"{stem.name} {origin}\n")
        if stem.with_suffix(".npz").exists():
            _require_origin(stem.with_suffix(".npz"), origin)
        else:
            write_test_scene(exposure, stem, origin)
        (out / "origins.txt").write_text("".join(names))
    return count


def _require_origin(path: Path, origin: str) -> None:
    """Complain unless a scene is the exposure that is to be written there."""
    try:
        with path.open("rb") as file, np.load(file) as stored:
            found = f"is {stored['origin']}"
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        found = "does not say what it is"
    if found != f"is {origin}":
        raise Blur2ViewError(f"{path}: {found}, not {origin}; name another folder or remove it")


def write_test_scene(exposure: Exposure, stem: Path, origin: str) -> None:
    """Write ``STEM.png``, ``STEM_open.png``, ``STEM_close.png`` and, last and whole, ``STEM.npz``."""
    width, height = cropped(exposure)
    pictures = {"": exposure.photograph, "_open": exposure.first, "_close": exposure.last}
    for suffix, picture in pictures.items():
        path = stem.with_name(f"{stem.name}{suffix}.png")
        cv2.imwrite(str(path), picture[:height, :width, ::-1])
    displacement, valid = grid_truth(exposure)
    F, pose = exposure.fundamental(), exposure.pose
    arrays: dict[str, Any] = {
        "displacement": displacement,
        "valid": valid,
        "static": np.ones_like(valid),
        "K": exposure.K,
        "R": np.full((3, 3), np.nan) if pose is None else pose.R,
        "t": np.full(3, np.nan) if pose is None else pose.t,
        "F": np.zeros((0, 3)) if F is None else F,
        "kind": np.array("measured" if pose is None else "rendered"),
        "origin": np.array(origin),
    }
    write_atomically(stem.with_suffix(".npz"), lambda file: np.savez(file, **arrays))


def write_shards(exposures: Iterable[Exposure], out: Path) -> int:
    """Write what :func:`tools.datasets.shards.load_shards` reads, SHARD a file. Return the number.

    All pictures must be of one size. Files are written whole; a stopped run starts anew.
    """
    out.mkdir(parents=True, exist_ok=True)
    left, count = iter(exposures), 0
    while chunk := list(islice(left, SHARD)):
        Scenes.join([record(exposure) for exposure in chunk]).save(out / f"train_{count:08d}.npz")
        count += len(chunk)
    return count


def record(exposure: Exposure) -> Scenes:
    """Return the training record of one exposure."""
    width, height = cropped(exposure)
    displacement, valid = grid_truth(exposure)
    labels = valid.astype(np.uint8) + 2 * np.ones_like(valid, np.uint8)
    linear = encode_linear(exposure.linear[:height, :width])
    half = displacement.astype(np.float16)
    return Scenes(linear=linear[None], displacement=half[None], labels=labels[None])
