"""Failure cases as a user sees them: the overlay with its verdict, beside what the scene really is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import estimate
from blur2view.visualization.overlay import draw_overlay
from tools.rendering.failure_scenes import KINDS, FailureScene, failure_scene
from tools.reports.figure_style import new_figure, show_picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEEDS = (0, 1)


def failure_figures(network: SmearNetwork, photos: Path | None, seeds: Sequence[int] = SEEDS) -> list[Figure]:
    """Return one figure for each kind of scene in `failure_scenes.KINDS`, in their order."""
    return [failure_figure([failure_scene(kind, seed, photos) for seed in seeds], network) for kind in KINDS]


def failure_figure(scenes: Sequence[FailureScene], network: SmearNetwork) -> Figure:
    """Return the overlays of scenes of one kind side by side, each under the truth."""
    figure = new_figure(6.4 * len(scenes), 6.5)
    for axes, scene in zip(figure.subplots(1, len(scenes), squeeze=False)[0], scenes, strict=True):
        image = np.asarray(scene.photograph, np.float32) / np.float32(255)
        found = estimate(image, network=network)
        show_picture(axes, draw_overlay(image, found.field, found.matches, found.geometry), caption(scene))
    return figure


def caption(scene: FailureScene) -> str:
    """Return what the scene is."""
    truth = scene.rendering
    length = np.median(np.linalg.norm(truth.displacement, axis=-1))
    moving = 1 - float(truth.static.mean())
    share = f", {moving:.0%} of the image moves by itself" if moving else ""
    return f"{scene.kind}, seed {scene.seed}: camera path {truth.kind}\nmedian smear {length:.0f} px{share}"
