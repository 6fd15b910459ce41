"""How good motion masks are, and whether cameras that stood still are called so; both halves of every set.

    python -m tools.evaluation.segmentation FOLDERS --out tools/results/segmentation.md

A folder holds ``NAME.jpg`` whose object is white in ``NAME.truth.png``; or scenes of `tools.datasets.testset`
or `tools.datasets.mover_scenes`; or photographs in which nothing moves. ``--standing`` names photographs by
cameras that stood still, before something that moves, ``--sharp`` folders of sharp ones. Masks and truth are
compared at the centres of 4 x 4 pixels. The page says which numbers were chosen on which photographs.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import blur2view
from blur2view import MotionLabel, MotionMask, SmearNetwork
from tools.command import Existing, Target, publish, run, table
from tools.datasets.testset import read_test_set
from tools.metrics import average_precision
from tools.rendering.render import GRID
from tools.rendering.textures import photographs_of

Mask = NDArray[np.bool_]
Record = dict[str, Any]

MIN_SHARE = 0.01  # of the picture that moves, for a photograph to count as one with movers
FALSE_SHARE = 0.005  # called moving where nothing moves: more is a miss
BLURRED_PX = 4.0  # median smear from which on photographs of a known object are a group of their own
MIN_SMEAR_PX = 2.0  # median smear below which a camera that moved need not be called so
HEAD = (
    "photographs | n | IoU | average precision | false area | false above 0.5 % | still: not said to move | "
    "still: named | moved: not said to"
)


def overlap(found: Mask, true: Mask) -> float:
    """Return the intersection over union; NaN where both are empty."""
    union = (found | true).sum()
    return float((found & true).sum() / union) if union else float("nan")


def judge(static: Mask, valid: Mask, mask: MotionMask) -> Record:
    """Return how a mask compares with what stands still, where known (both (h, w), of 4 x 4 pixels).

    ``share`` moves; ``iou`` and ``precision`` may be NaN where nothing does; ``called`` is called moving.
    """
    sides = zip(valid.shape, mask.labels.shape, strict=True)
    rows, columns = np.ix_(*(np.minimum(GRID * np.arange(n) + 1, side - 1) for n, side in sides))
    label, score = (of[rows, columns][valid] for of in (mask.labels, mask.probability))
    moving, called = ~static[valid], label == MotionLabel.MOVING
    return {
        "share": float(moving.sum() / valid.size),
        "iou": overlap(called, moving),
        "precision": average_precision(score, moving),
        "called": float(called.mean()),
    }


def photographs(
    folder: Path, standing: list[str], sharp: list[str]
) -> Iterator[tuple[Path, Mask, Mask, Record]]:
    """Yield a folder's photographs: path, what stands still, where that is known, and the camera's motion."""
    if next(folder.glob("[0-9]*.npz"), None) and not next(folder.glob("*.jpg"), None):
        for scene in read_test_set(folder):
            lengths = np.linalg.norm(scene.displacement, axis=-1)[scene.static & scene.valid]
            true_px, stands = float(np.median([0.0, *lengths])), scene.kind in ("rest", "unmoved")
            yield scene.image_path, scene.static, scene.valid, {"stands": stands, "true_px": true_px}
        return
    for path in photographs_of([folder]):
        if path.name.endswith(".truth.png"):
            continue
        outlines = path.with_name(f"{path.stem}.truth.png")
        picture = blur2view.read_image(outlines if outlines.exists() else path)[1::GRID, 1::GRID, 0]
        static = picture == 0 if outlines.exists() else np.ones_like(picture, bool)
        known = {"stands": path.stem in standing, "sharp": folder.name in sharp, "object": outlines.exists()}
        yield path, static, np.ones_like(static), known


def record_of(path: Path, static: Mask, valid: Mask, known: Record, network: SmearNetwork) -> Record:
    """Return what is found in a photograph, beside what is known of it."""
    image = blur2view.read_image(path)
    found = blur2view.estimate(image, network=network)
    smear_px = float(np.median(found.grid.smears().length_px))
    disc_px = 2 * (found.blur.defocus_px or 0.0) if "true_px" in known else 0.0
    read = {"smear_px": smear_px, "disc_px": disc_px, "kind": str(found.blur.kind)}
    judged = judge(static, valid, blur2view.segment(found, image))
    return {"true_px": smear_px, "sharp": False, **known, **judged, **read}


def groups_of(name: str, records: list[Record]) -> dict[str, list[Record]]:
    """Return the records of a set, those of known objects by the length of their smears."""
    if not records[0].get("object"):
        return {name: records}
    blurred = [one for one in records if one["smear_px"] >= BLURRED_PX]
    between = [one for one in records if MIN_SMEAR_PX <= one["smear_px"] < BLURRED_PX]
    return {f"{name}, 4 px and more": blurred, f"{name}, 2 to 4 px": between}


def figures_of(records: list[Record]) -> list[str]:
    """Return the cells of a half of a row."""
    some = [one for one in records if one["share"] >= MIN_SHARE]
    none = [one for one in records if not one["share"] and not one["stands"]]
    stood = [one for one in records if one["stands"] and (one["share"] >= MIN_SHARE or "object" in one)]
    moved = [one for one in records if not (one["stands"] or one["sharp"])]
    moved = [one for one in moved if one["true_px"] >= max(MIN_SMEAR_PX, one["disc_px"])]

    def mean(rows: list[Record], key: str) -> str:
        return f"{np.nanmean([one[key] for one in rows]):.3f}" if rows else "-"

    def count(rows: list[Record], is_hit: Callable[[Record], bool]) -> str:
        return f"{sum(map(is_hit, rows))} of {len(rows)}" if rows else "-"

    return [
        str(len(records)),
        *(mean(some, key) for key in ("iou", "precision")),
        mean(none, "called"),
        count(none, lambda one: one["called"] > FALSE_SHARE),
        count(stood, lambda one: "moved" not in one["kind"]),
        count(stood, lambda one: one["kind"] == "camera at rest"),
        count(moved, lambda one: "moved" not in one["kind"]),
    ]


def main(
    folders: list[Existing], *, standing: list[str] | None = None, sharp: list[str] | None = None, out: Target
) -> None:
    """Judge all photographs of folders."""
    network, rows = SmearNetwork(), []
    for folder in folders:
        records = [record_of(*one, network) for one in photographs(folder, standing or [], sharp or [])]
        for name, group in groups_of(folder.name, records).items():
            pairs = zip(figures_of(group[::2]), figures_of(group[1::2]), strict=True)
            rows.append([name, *("; ".join(pair) if set(pair) != {"-"} else "" for pair in pairs)])
    publish(out, f"Network `{network.model_id}` and those that find movers.", table(HEAD, rows))


if __name__ == "__main__":
    run(main)
