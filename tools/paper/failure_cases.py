"""Count what is said of photographs that leave F open: the supplement's failure cases."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

import blur2view
from blur2view.arrays import Array
from blur2view.geometry.two_view_geometry import Configuration, Parallax, TwoViewGeometry
from blur2view.smears.field import smear_ends
from tools.metrics import rho
from tools.rendering.exposure import grid_points
from tools.rendering.failure_scenes import KINDS, FailureScene, failure_scene
from tools.rendering.render import Rendering

SEEDS = 10
GOOD_RHO = 0.1
"""Error of F over the length of smears, up to which an F is taken to be that of the camera."""


def verdict(geometry: TwoViewGeometry) -> str:
    """Return the configuration and whether parallax is proven, undecided or absent."""
    return f"{geometry.config.name}, parallax {geometry.parallax}"


def correct(scene: FailureScene, geometry: TwoViewGeometry) -> bool:
    """Whether the verdict does not mislead.

    Of one plane and of a pure rotation: no proven parallax. Of many movers: no F, several motions, or an F
    that fits what stands still (median rho below GOOD_RHO).
    """
    if scene.kind != "many movers":
        return geometry.parallax is not Parallax.PROVEN
    if geometry.F is None:
        return True
    good = float(np.median(rho(geometry.F, static_ends(scene.rendering)))) < GOOD_RHO
    return good or geometry.config is Configuration.MULTIPLE


def static_ends(truth: Rendering) -> Array:
    """Return the true ends (N, 2, 2) of what stands still and is seen at both."""
    seen = truth.static & truth.valid
    height, width = truth.linear.shape[:2]
    middle = (grid_points((width, height)) + truth.middle_offset)[seen]
    return smear_ends(middle, truth.displacement[seen])


def counts(scenes: Iterable[FailureScene], network: blur2view.SmearNetwork) -> dict[str, object]:
    """Return the numbers of verdicts on scenes of one kind."""
    names: Counter[str] = Counter()
    right = 0
    for scene in scenes:
        image = np.asarray(scene.photograph, np.float32) / np.float32(255)
        geometry = blur2view.estimate(image, network=network).geometry
        names[verdict(geometry)] += 1
        right += correct(scene, geometry)
    return {"verdicts": dict(names.most_common()), "not misled": right, "images": names.total()}


def markdown(document: dict[str, dict[str, object]]) -> list[str]:
    """Return the counts as lines of Markdown."""
    lines = ["| scenes | images | not misled | verdicts |", "|---|---|---|---|"]
    for kind, row in document.items():
        verdicts = row["verdicts"]
        assert isinstance(verdicts, dict)
        said = "; ".join(f"{count} {name}" for name, count in verdicts.items())
        lines.append(f"| {kind} | {row['images']} | {row['not misled']} | {said} |")
    return lines


def study(network: blur2view.SmearNetwork, photos: Path | None, seeds: Sequence[int]) -> dict[str, object]:
    """Return the counts of all kinds, as they are stored."""
    kinds = {kind: counts((failure_scene(kind, s, photos) for s in seeds), network) for kind in KINDS}
    return {"model_id": network.info.model_id, "kinds": kinds}
