"""The tables of the videos' reconstructions."""

from __future__ import annotations

import numpy as np

from tools.reconstruction.alignment import MotionErrors, centres, rotation_errors_deg
from tools.reconstruction.sfm_result import Model, Result


def markdown(result: Result) -> str:
    """Return both tables of a recording."""
    photographs = len(result.names)
    joined, single = result.errors(result.motion), result.errors(result.estimated)
    placed = result.motion_of(result.placed)
    registered = np.isfinite(joined.rotation)
    known = np.array([bool(fact["time_known"]) for fact in result.facts])
    what = "the true one" if result.recording.exposure_known else "the frame interval"
    rows = [
        f"## {result.recording.name}: {photographs} frames, {result.model_id}",
        "",
        "| | without views | views placed | views mapped | with views, global mapping |",
        "|---|---|---|---|---|",
        *model_rows(result),
        "",
        f"Both views of {registered.sum()} photographs are registered; time direction called known for "
        f"{known.sum()}. Exposure over {what}: {result.exposure(result.motion):.3f} by the model's "
        f"rotations, {result.exposure(placed):.3f} as views were placed, "
        f"{result.exposure(result.estimated):.3f} by those of single photographs.",
        "",
        "| motion during the exposure, median | photographs | rotation error | time direction right "
        "| translation's direction, degrees | translation error |",
        "|---|---|---|---|---|---|",
        *placed_row(result),
        motion_row("model with views", joined),
        *global_row(result),
        motion_row("single photographs", single, scaled=False),
        "",
        "| frame | configuration | usable | true rotation, degrees | placed | mapped | single | time right |",
        "|---|---|---|---|---|---|---|---|",
        *frame_rows(result, result.errors(placed), joined, single),
        "",
    ]
    return "\n".join(rows)


def model_rows(result: Result) -> list[str]:
    """Return sizes and pose errors of the models."""
    models = (result.without, result.placed, result.joined, result.averaged)
    columns = [model_column(result, model) for model in models]
    labels = ["photographs registered", "views registered", "points", "reprojection error, px"]
    labels += ["median rotation error, degrees", "median position error, of the path's extent"]
    return [f"| {label} | {' | '.join(cells)} |" for label, *cells in zip(labels, *columns, strict=True)]


def model_column(result: Result, model: Model) -> list[str]:
    """Return size and pose errors of a model."""
    if not model.poses:
        return ["0", "0", "0", "-", "-", "-"]
    extent = float(np.linalg.norm(np.ptp(centres(result.recording.poses), axis=0)))
    poses = model.of(result.names)
    seen = np.isfinite(poses).all(axis=(1, 2))
    aligned, true = result.alignment_of(model).poses(poses[seen]), result.recording.poses[seen]
    off = np.linalg.norm(centres(aligned) - centres(true), axis=1) / extent
    return [
        f"{seen.sum()}",
        f"{len(model.poses) - seen.sum()}",
        f"{model.points}",
        f"{model.error_px:.3f}",
        f"{np.median(rotation_errors_deg(aligned, true)):.3f}",
        f"{np.median(off):.2%}",
    ]


def placed_row(result: Result) -> list[str]:
    """Return the motion by the model in which views were placed, if there is one."""
    if not result.placed.poses:
        return []
    return [motion_row("views placed by the trajectory", result.errors(result.motion_of(result.placed)))]


def global_row(result: Result) -> list[str]:
    """Return the motion by the model of global mapping, if there is one."""
    if not result.averaged.poses:
        return []
    return [motion_row("model with views, global mapping", result.errors(result.motion_of(result.averaged)))]


def motion_row(name: str, errors: MotionErrors, scaled: bool = True) -> str:
    """Return medians over the frames with a motion; translations of single photographs have no length."""
    seen = np.isfinite(errors.rotation)
    if not seen.any():
        return f"| {name} | 0 | - | - | - | - |"
    rotation = f"{np.median(errors.rotation[seen]):.1%}"
    translation = f"{np.median(errors.translation[seen]):.0%}" if scaled else "-"
    return (
        f"| {name} | {seen.sum()} | {rotation} | {np.mean(errors.forward[seen]):.0%} "
        f"| {np.median(errors.heading_deg[seen]):.1f} | {translation} |"
    )


def frame_rows(result: Result, placed: MotionErrors, joined: MotionErrors, single: MotionErrors) -> list[str]:
    """Return a row per photograph: rotation errors, and whether placed views are in the right order."""
    rows, true = [], np.degrees(np.linalg.norm(result.true_motion.rotations, axis=1))
    facts = {fact["name"]: fact for fact in result.facts}
    for k, name in enumerate(result.names):
        fact = facts.get(name, {"config": "-", "num_matches": 0})
        cells = ["-" if np.isnan(e.rotation[k]) else f"{e.rotation[k]:.0%}" for e in (placed, joined, single)]
        right = "-" if np.isnan(placed.forward[k]) else "yes" if placed.forward[k] else "no"
        rows.append(
            f"| {name} | {fact['config']} | {fact['num_matches']} | {true[k]:.2f} "
            f"| {' | '.join(cells)} | {right} |"
        )
    return rows
