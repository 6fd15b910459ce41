"""What stands still in a frame because the points of COLMAP's model are seen in it.

A single photograph may show a near board, or something smooth, as if it moved by itself, or mark too much
around what does. The points of a model stand still, so that few keypoints on what moves show one.
"""

from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial import cKDTree

from blur2view.arrays import Array, Floats, Mask
from blur2view.camera import from_colmap
from blur2view.colmap.models import read_model, registered_images

MIN_TRACK = 3  # frames that see a point: two frames also agree about what moves along their epipolar lines
MIN_SHARE = 0.1  # bound: where fewer of a frame's keypoints outside a part show a point, as many are taken to
# Of the picture's longer side, 8 px of 640: keypoints so near a part's edge may lie beside a mover, which was
# erased if it had few of its own. With it 1 still frame below has a mask, and the board's IoU is 0.52.
EDGE = 0.0125
# Of a video of 60 s in which nothing moves 26 of 340 frames had masks, and 2 have them; of 36 frames with a
# board that moves before the same wall masks had an IoU of 0.38 with the true ones (precision 0.50), and have
# 0.53 (0.89). These chose the next three numbers. 11 frames of DAVIS's dance-twirl have 0.37 (before: 0.36).
SAME_SHARE = 0.3  # of that share, from which on it stands still there
NEAREST = 16  # keypoints in a part that say so of a pixel; nothing is said of a part with fewer
MIN_REMAINS = 0.2  # of a part's pixels: what remains in smaller pieces is chance
GRID_PX = 640  # of the longer side, at most, on which a part is judged
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
        """Return a mask (H, W) of what moves in a frame without what stands still.

        Of each connected part stays where fewer of the nearest keypoints in it, not at its edge, show a point
        than elsewhere, and all of it if it has few. Small remains go.
        """
        sighted, step = self.sighted(name), max(1, max(moving.shape) // GRID_PX)
        count, parts = cv2.connectedComponents(moving.astype(np.uint8))
        last = np.array(moving.shape[::-1]) - 1
        x, y = np.clip(np.rint(sighted.pixels), 0, last).astype(int).T
        part, inner = parts[y, x], _depth(moving)[y, x] > EDGE * max(moving.shape)
        outside = sighted.seen[part == 0]
        usual = max(MIN_SHARE, float(outside.mean()) if len(outside) else 0.0)
        static = np.zeros(moving[::step, ::step].shape, bool)
        for k in range(1, count):
            own, rows_columns = (part == k) & inner, np.argwhere(parts[::step, ::step] == k)
            if own.sum() < NEAREST or not len(rows_columns):
                continue
            seen, tree = sighted.seen[own], cKDTree(sighted.pixels[own])
            _, nearest = tree.query(step * rows_columns[:, ::-1], k=NEAREST)
            share = seen[nearest].mean(axis=1)
            still = np.zeros(static.shape, bool)
            still[tuple(rows_columns.T)] = share >= SAME_SHARE * usual
            static |= still | _small((parts[::step, ::step] == k) & ~still, MIN_REMAINS * len(rows_columns))
        whole = cv2.resize(static.astype(np.uint8), moving.shape[::-1], interpolation=cv2.INTER_NEAREST)
        return np.asarray(moving & (whole == 0))


def _depth(moving: Mask) -> Floats:
    """Return how far inside a mask its pixels are; the picture's border is not an edge."""
    padded = np.pad(moving.astype(np.uint8), 1, mode="edge")
    return np.asarray(cv2.distanceTransform(padded, cv2.DIST_L2, 3)[1:-1, 1:-1])


def _small(moving: Mask, least: float) -> Mask:
    """Mark the connected parts of a mask that have fewer pixels."""
    _, parts, stats, _ = cv2.connectedComponentsWithStats(moving.astype(np.uint8), connectivity=4)
    return np.asarray((stats[:, cv2.CC_STAT_AREA] < least)[parts] & moving)
