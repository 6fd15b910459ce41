"""Link a rendered video's views from its true smears: what COLMAP makes of a network that does not err."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from blur2view.arrays import AnyArray as Array
from blur2view.camera.camera import Camera
from blur2view.colmap.database_matches import DatabaseMatcher
from blur2view.colmap.link import LinkJob, LinkStep, plan_links, write_links
from blur2view.errors import Blur2ViewError
from blur2view.exposure.linked_views import KeypointViews, keypoint_views
from blur2view.exposure.time_direction import consecutive_runs, with_time_direction
from blur2view.pipeline import Estimate, Timings
from blur2view.smears.field import SmearField
from blur2view.smears.sampling import select_matches
from blur2view.two_view.estimate import estimate_two_view

SIGMA_PX = 0.5
"""Stated of true smears: they are straight, the paths of the camera are not."""


def true_field(displacement: Array, rng: np.random.Generator) -> SmearField:
    """Return true smears (h, w, 2) of the stride-4 grid as a field, without their time direction."""
    height, width = 4 * displacement.shape[0], 4 * displacement.shape[1]
    signed = displacement.astype(np.float32) * np.float32(rng.choice([-1.0, 1.0]))
    # nearest, as no smear lies between those of two surfaces
    full = np.asarray(cv2.resize(signed, (width, height), interpolation=cv2.INTER_NEAREST), np.float32)
    return SmearField(displacement=full, sigma_px=np.full((height, width), SIGMA_PX, np.float32))


def true_estimate(field: SmearField, camera: Camera) -> Estimate:
    """Return the geometry estimated from a field, as `blur2view.estimate` does from a photograph."""
    matches = select_matches(field)
    return Estimate(
        field=field,
        matches=matches,
        geometry=estimate_two_view(matches, rng=np.random.default_rng(0), camera=camera),
        model_id="true smears",
        timings=Timings(predict_s=0.0, select_s=0.0, solve_s=0.0),
        camera=camera,
    )


def link_true(database: Path, paths: Sequence[Path], K: Array, displacement: Array) -> list[dict[str, Any]]:
    """Add views of true smears (N, h, w, 2) to a database, as ``to-colmap --link --sequence`` adds them.

    Returns
    -------
    list of dict
        Of every photograph its name, configuration, usable features, and whether the time direction is known.

    Raises
    ------
    Blur2ViewError
        If a photograph is not in the database.
    """
    rng = np.random.default_rng(0)
    camera = Camera(K=K, width=4 * displacement.shape[2], height=4 * displacement.shape[1])
    plans, linked = [_found(plan) for plan in plan_links(database, paths)], []
    for plan, smears in zip(plans, displacement, strict=True):
        found = true_estimate(true_field(smears, rng), camera)
        linked.append(keypoint_views(plan.image.name, plan.image.keypoints, found))
    names = [plan.image.name for plan in plans]
    matcher = DatabaseMatcher(database, names)
    views = with_time_direction(
        [one.views for one in linked], consecutive_runs(names, in_order=True), matcher
    )
    linked = [replace(one, views=turned) for one, turned in zip(linked, views, strict=True)]
    write_links(
        database, [LinkJob(plan=p, linked=one) for p, one in zip(plans, linked, strict=True)], backup=False
    )
    return [_facts(one) for one in linked]


def _found(plan: LinkStep | Blur2ViewError) -> LinkStep:
    """Return a plan; raise the error in its place."""
    if isinstance(plan, Blur2ViewError):
        raise plan
    return plan


def _facts(one: KeypointViews) -> dict[str, Any]:
    """Return what `to-colmap --json` prints of it."""
    return {
        "name": one.views.name,
        "config": one.views.geometry.config.name,
        "num_matches": int(one.usable.sum()),
        "time_known": one.views.time.known,
    }
