"""What the figures are drawn of: photographs with truth, and everything the shipped network makes of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray
from blur2view.camera.image import read_image
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.metrics import epe_s, rho
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import estimate
from blur2view.smears.field import SmearField
from blur2view.smears.matches import SmearMatches
from tools.datasets.testset import TestScene
from tools.evaluation.evaluate import true_ends


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One photograph of the test split, its truth, and what was found in it."""

    scene: TestScene
    field: SmearField
    matches: SmearMatches
    geometry: TwoViewGeometry

    @property
    def image(self) -> AnyArray:
        """The photograph (H, W, 3), float32 in [0, 1]."""
        return read_image(self.scene.image_path)

    def sharp(self, end: str) -> AnyArray:
        """Return the sharp frame at shutter-"open" or "close", (H, W, 3)."""
        return read_image(self.scene.image_path.with_stem(f"{self.scene.name}_{end}"))

    @property
    def displacement(self) -> AnyArray:
        """Predicted smears (h, w, 2) on the grid of the truth."""
        return np.asarray(self.field.displacement[1::4, 1::4])

    @property
    def sigma_px(self) -> AnyArray:
        """Their sigma (h, w)."""
        return np.asarray(self.field.sigma_px[1::4, 1::4])

    @property
    def sure(self) -> NDArray[np.bool_]:
        """The more certain half (h, w)."""
        sigma = self.sigma_px
        return np.asarray(sigma <= np.median(sigma))

    @property
    def relative_error(self) -> float:
        """Mean EPE-S of the valid smears of the certain half, over their mean length."""
        chosen = self.sure & self.scene.valid
        true = self.scene.displacement[chosen]
        return float(epe_s(self.displacement[chosen], true).mean() / np.linalg.norm(true, axis=1).mean())

    @property
    def rho(self) -> float:
        """Median error of F on true smears over their length; infinite without F or without a true one."""
        if self.geometry.F is None or self.scene.F is None:
            return float("inf")
        return float(np.median(rho(self.geometry.F, true_ends(self.scene))))


def cases(scenes: Iterable[TestScene], network: SmearNetwork) -> Iterator[Case]:
    """Yield the whole path's answer on every photograph."""
    for scene in scenes:
        found = estimate(read_image(scene.image_path), network=network)
        yield Case(scene=scene, field=found.field, matches=found.matches, geometry=found.geometry)


def at_quantiles(
    found: Sequence[Case], measure: Callable[[Case], float], quantiles: Sequence[float]
) -> list[Case]:
    """Return the cases at these quantiles of a measure, of those where it is finite: no choice by hand.

    ValueError if it is finite nowhere.
    """
    values = np.array([measure(case) for case in found])
    order = np.argsort(values, kind="stable")[: int(np.isfinite(values).sum())]
    if not len(order):
        raise ValueError("no case has a finite measure")
    return [found[order[round(q * (len(order) - 1))]] for q in quantiles]


def at_pixels(grid: AnyArray, shape: tuple[int, int]) -> AnyArray:
    """Return a map (h, w) of the grid enlarged to pixels (H, W), cell by cell."""
    coarse = grid.astype(np.float32)
    return np.asarray(cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_NEAREST))
