"""How good motion masks are: rendered photographs with movers and without, and real ones.

    python -m tools.evaluation.segmentation render/test render/movers --out tools/results/segmentation.md

Truth and masks are compared at the centres of the truth's cells, 4 x 4 pixels, where smears are known. The
scenes of one folder count as one split: `tools.datasets.testset` makes the test split,
`tools.datasets.mover_scenes` others. ``--still`` are folders of photographs in which nothing moves,
``--objects`` one of photographs ``NAME.jpg`` whose object is white in ``NAME.truth.png``.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import blur2view
from blur2view import MotionLabel, MotionMask, SmearNetwork
from blur2view.arrays import AnyArray
from tools.arguments import Existing, Target, run
from tools.datasets.blurred_photographs import photographs_of
from tools.datasets.testset import read_test_set
from tools.metrics import average_precision
from tools.pages import publish, table
from tools.rendering.exposure import GRID

Mask = NDArray[np.bool_]
LEAST_SHARE = 0.01  # of the picture that moves, for a scene to count as one with movers
FALSE_SHARE = 0.005  # called moving where nothing moves: more is a miss
COLUMNS = ("iou", "precision", "called", "unobservable")
WORDS = (
    "Means over scenes, of everywhere that smears are known: IoU of what is called moving with what moves, "
    "average precision of the probability, shares that are called moving and unobservable."
)


@dataclass(frozen=True, kw_only=True)
class SceneFigures:
    """One scene: what moves, what was called moving, and how well the probability ranks.

    ``is_still``: nothing moves at all. ``iou`` and ``precision`` may be NaN where nothing moves. ``counts``
    (2, 10) are all pixels, and those that move, by tenths of the probability.
    """

    share: float
    is_still: bool
    iou: float
    precision: float
    called: float
    unobservable: float
    counts: AnyArray


def overlap(found: Mask, true: Mask) -> float:
    """Return the intersection over union; NaN where both are empty."""
    union = (found | true).sum()
    return float((found & true).sum() / union) if union else float("nan")


def judge(static: Mask, valid: Mask, mask: MotionMask) -> SceneFigures:
    """Return how a mask compares with what stands still, where known (both (h, w), of 4 x 4 pixels)."""
    sides = zip(valid.shape, mask.labels.shape, strict=True)
    rows, columns = np.ix_(*(np.minimum(GRID * np.arange(n) + 1, side - 1) for n, side in sides))
    label, score = (of[rows, columns][valid] for of in (mask.labels, mask.probability))
    moving, called = ~static[valid], label == MotionLabel.MOVING
    tenth = np.minimum((10 * score).astype(int), 9)
    return SceneFigures(
        share=float(moving.sum() / valid.size),
        is_still=bool(static.all()),
        iou=overlap(called, moving),
        precision=average_precision(score, moving),
        called=float(called.mean()),
        unobservable=float((label == MotionLabel.UNOBSERVABLE).mean()),
        counts=np.stack([np.bincount(tenth, minlength=10), np.bincount(tenth, moving, minlength=10)]),
    )


def split_rows(name: str, judged: list[SceneFigures]) -> Iterator[tuple[str, ...]]:
    """Yield means of a split over scenes with movers and over those without any, unknown values left out."""
    still = [one for one in judged if one.is_still]
    many = sum(scene.called > FALSE_SHARE for scene in still)
    groups = {"movers of 1 % or more": [one for one in judged if one.share >= LEAST_SHARE]}
    groups[f"no movers ({many} over {FALSE_SHARE:.1%})"] = still
    for kind, scenes in groups.items():
        if scenes:
            values = (np.array([getattr(scene, column) for scene in scenes], float) for column in COLUMNS)
            known = [value[np.isfinite(value)] for value in values]
            means = (f"{value.mean():.3f}" if len(value) else "-" for value in known)
            yield f"{name}, {kind}", str(len(scenes)), *means


def calibration(scenes: list[SceneFigures]) -> list[str]:
    """Return a table of the probability: of the pixels in each tenth, how many move."""
    every, moving = np.sum([scene.counts for scene in scenes], axis=0)
    shares = ("-" if not n else f"{k / n:.2f}" for n, k in zip(every, moving, strict=True))
    tenths = " | ".join(f"{k / 10:.1f}-{(k + 1) / 10:.1f}" for k in range(10))
    pixels = (f"{n / every.sum():.4f}" for n in every)
    return table(f"probability | {tenths}", [("share of the pixels", *pixels), ("of these, moving", *shares)])


def mask_of(image: AnyArray, network: SmearNetwork) -> MotionMask:
    """Return the mask of a picture (H, W, 3)."""
    return blur2view.segment(blur2view.estimate(image, network=network), image)


def rendered(folder: Path, network: SmearNetwork) -> list[SceneFigures]:
    """Return the figures of the scenes of a folder."""
    scenes = read_test_set(folder)
    return [judge(one.static, one.valid, mask_of(one.image, network)) for one in scenes]


def outlined(folder: Path, network: SmearNetwork) -> Iterator[SceneFigures]:
    """Yield the figures of photographs whose object is known."""
    for path in sorted(folder.glob("*.truth.png")):
        still = blur2view.read_image(path)[1::GRID, 1::GRID, 0] == 0
        image = blur2view.read_image(path.with_name(f"{path.name.removesuffix('.truth.png')}.jpg"))
        yield judge(still, np.ones_like(still), mask_of(image, network))


def still_line(folder: Path, network: SmearNetwork) -> str:
    """Return what is called moving in photographs in which nothing moves."""
    masks = (mask_of(blur2view.read_image(path), network) for path in photographs_of([folder]))
    shares = np.array([(mask.labels == MotionLabel.MOVING).mean() for mask in masks])
    return (
        f"- {folder.name}, {len(shares)} still photographs: {shares.mean():.2%} called moving, "
        f"{shares.max():.2%} at most, more than {FALSE_SHARE:.1%} in {(shares > FALSE_SHARE).sum()}"
    )


def main(
    scenes: list[Existing],
    *,
    still: list[Existing] | None = None,
    objects: Existing | None = None,
    out: Target | None = None,
) -> None:
    """Segment rendered scenes and photographs, and write the page."""
    network = SmearNetwork()
    judged = {folder.name: rendered(folder, network) for folder in scenes}
    if objects:
        judged[objects.name] = list(outlined(objects, network))
    rows = [row for name, found in judged.items() for row in split_rows(name, found)]
    publish(
        out,
        "# Motion masks",
        WORDS,
        table(f"scenes | n | {' | '.join(COLUMNS)}", rows),
        *(block for name, found in judged.items() for block in (f"Calibration, {name}:", calibration(found))),
        [still_line(folder, network) for folder in still or ()],
    )


if __name__ == "__main__":
    run(main)
