"""Which parts of a frame stand still because the points of COLMAP's model are seen in them.

A single photograph may show a near board, or something smooth, as if it moved by itself. The points of a
model stand still, so that few keypoints on what moves show one.
"""

from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from blur2view.arrays import Array, Mask
from blur2view.camera import from_colmap
from blur2view.colmap.models import read_model, registered_images

MIN_TRACK = 3  # frames that see a point: two frames also agree about what moves along their epipolar lines
MIN_SHARE = 0.1  # of a frame's keypoints outside a part that show a point; of fewer nothing is said
SAME_SHARE = 0.5  # of that share, from which on a part stands still
LATTICE_PX = 16  # between pixels that stand for the keypoints of a frame that has only those of its points


class Sighted(NamedTuple):
    """Pixels of a frame at which a point of the model might be seen."""

    pixels: Array  # (N, 2)
    seen: Mask  # (N,) whether one is


class StaticPoints:
    """The points of a scene's model, as its frames see them.

    Keypoints of frames that COLMAP registered show a point, or none. Of ``recovered`` frames those without
    one are unknown, and a lattice stands for them.
    """

    def __init__(self, model: Path, recovered: Collection[str]) -> None:
        self._model, self._recovered = read_model(model), frozenset(recovered)
        self._images = registered_images(self._model)
        self._long = {
            number for number, point in self._model.points3D.items() if point.track.length() >= MIN_TRACK
        }

    def sighted(self, name: str) -> Sighted:
        """Return where a frame sees points of the model, and where it might."""
        image = self._images[name]
        keypoints = [point.xy for point in image.points2D]
        pixels = from_colmap(np.array(keypoints, float).reshape(-1, 2))
        seen = np.array([point.point3D_id in self._long for point in image.points2D], bool)
        if name not in self._recovered:
            return Sighted(pixels, seen)
        camera = self._model.cameras[image.camera_id]
        sides = (np.arange(0, side, LATTICE_PX, dtype=float) for side in (camera.width, camera.height))
        lattice = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
        every = np.concatenate([pixels[seen], lattice])
        return Sighted(every, np.arange(len(every)) < seen.sum())

    def without_static(self, name: str, moving: Mask) -> Mask:
        """Return a mask (H, W) of what moves in a frame without the connected parts that stand still."""
        sighted = self.sighted(name)
        count, parts = cv2.connectedComponents(moving.astype(np.uint8))
        last = np.array(moving.shape[::-1]) - 1
        x, y = np.clip(np.rint(sighted.pixels), 0, last).astype(int).T
        part = parts[y, x]
        every, seen = (np.bincount(one, minlength=count) for one in (part, part[sighted.seen]))
        share = seen / np.maximum(every, 1)
        static = share >= SAME_SHARE * max(share[0], MIN_SHARE)
        static[0] = True
        return np.asarray(~static[parts])
