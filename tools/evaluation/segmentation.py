"""How good motion masks are: rendered photographs with movers and without, and real ones.

``python -m tools.evaluation.segmentation render/test render/movers --out tools/results/segmentation`` writes
``segmentation.md``. Truth and masks are compared at the centres of the truth's cells, 4 x 4 pixels, where
smears are known. The scenes of one folder count as one split: `tools.datasets.testset` makes the test split,
`tools.datasets.mover_scenes` another with a mover in every picture.
"""

import shlex
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray
from blur2view.images.image import read_image
from blur2view.movers.mask import MotionLabel, MotionMask, segment
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import estimate
from blur2view.smears.field import Floats
from tools.arguments import Existing, Target, run
from tools.datasets.testset import read_test_set
from tools.metrics import average_precision
from tools.pages import joined, publish, table
from tools.rendering.exposure import GRID

Mask = NDArray[np.bool_]

REAL = Path("../shared/data/real")
STREETS = ("gopro_street_01.png", "gopro_street_07.png")  # nothing in them moves
STATIC = [Path("../shared/data/redkitchen"), Path("../shared/data/textures/kodak")]
LEAST_SHARE = 0.01  # of the picture that moves, for a scene to count as one with movers
FALSE_SHARE = 0.005  # called moving where nothing moves: more is a miss
COLUMNS = ("iou", "precision", "called", "unobservable")
HEADS = f"scenes | n | {' | '.join(COLUMNS)}"
WORDS = (
    "Means over scenes, of everywhere that smears are known: IoU of what is called moving with what moves, "
    "average\nprecision of the probability, shares that are called moving and unobservable."
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


def split_rows(name: str, judged: list[SceneFigures]) -> list[tuple[str, ...]]:
    """Return rows of a split: scenes with movers, scenes without any."""
    some = [one for one in judged if one.share >= LEAST_SHARE]
    still = [one for one in judged if one.is_still]
    many = sum(scene.called > FALSE_SHARE for scene in still)
    named = {"movers of 1 % or more": some, f"no movers ({many} over {FALSE_SHARE:.1%})": still}
    return [_row(f"{name}, {kind}", scenes) for kind, scenes in named.items() if scenes]


def _row(name: str, scenes: list[SceneFigures]) -> tuple[str, ...]:
    """Return means over scenes, those without a value left out."""
    values = (np.array([getattr(scene, column) for scene in scenes], float) for column in COLUMNS)
    known = [value[np.isfinite(value)] for value in values]
    return name, str(len(scenes)), *(f"{value.mean():.3f}" if len(value) else "-" for value in known)


def calibration_lines(scenes: list[SceneFigures]) -> list[str]:
    """Return a table of the probability: of the pixels in each tenth, how many move."""
    every, moving = np.sum([scene.counts for scene in scenes], axis=0)
    shares = ("-" if not n else f"{k / n:.2f}" for n, k in zip(every, moving, strict=True))
    tenths = " | ".join(f"{k / 10:.1f}-{(k + 1) / 10:.1f}" for k in range(10))
    pixels = (f"{n / every.sum():.4f}" for n in every)
    rows = [("share of the pixels", *pixels), ("of these, moving", *shares)]
    return table(f"probability | {tenths}", rows)


def still_lines(groups: dict[str, list[Path]], network: SmearNetwork) -> list[str]:
    """Return what is called moving in real photographs in which nothing moves."""
    lines = []
    for name, paths in groups.items():
        pictures = [path for path in paths if path.suffix in (".jpg", ".png")]
        masks = (mask_of(read_image(path), network) for path in pictures)
        shares = np.array([(mask.labels == MotionLabel.MOVING).mean() for mask in masks])
        lines.append(
            f"- {name}, {len(shares)} photographs in which nothing moves: {shares.mean():.2%} called moving, "
            f"{shares.max():.2%} at most, more than {FALSE_SHARE:.1%} in {(shares > FALSE_SHARE).sum()}"
        )
    return lines


def outlined(folder: Path, network: SmearNetwork) -> Iterator[SceneFigures]:
    """Yield the figures of photographs ``NAME.jpg`` whose object is white in ``NAME.truth.png``."""
    for path in sorted(folder.glob("*.truth.png")):
        still = read_image(path)[1::GRID, 1::GRID, 0] == 0
        image = read_image(path.with_name(f"{path.name.removesuffix('.truth.png')}.jpg"))
        yield judge(still, np.ones_like(still), mask_of(image, network))


def mask_of(image: Floats, network: SmearNetwork) -> MotionMask:
    """Return the mask of a picture (H, W, 3)."""
    return segment(estimate(image, network=network), image)


def main(
    scenes: list[Existing], *, static: list[Path] | None = None, objects: Existing | None = None, out: Target
) -> None:
    """Segment rendered scenes, and photographs in which nothing moves.

    In ``objects`` are photographs whose object, moving or not, is known.
    """
    network = SmearNetwork()
    judged = {
        folder: [judge(one.static, one.valid, mask_of(one.image, network)) for one in read_test_set(folder)]
        for folder in scenes
    }
    rows = [row for folder, found in judged.items() for row in split_rows(folder.name, found)]
    command = f"python -m tools.evaluation.segmentation {shlex.join(sys.argv[1:])}"
    blocks: list[str | list[str]] = [
        "# Motion masks",
        f"`{command}`; network `{network.model_id}`.",
        WORDS,
        table(HEADS, rows),
        "Calibration, all pixels of all scenes:",
        calibration_lines([one for found in judged.values() for one in found]),
    ]
    if objects:
        found = list(outlined(objects, network))
        rows = split_rows(objects.name, found)[:1]
        blocks += ["Real photographs whose object is known:", table(HEADS, rows), calibration_lines(found)]
    groups = {"streets": [REAL / name for name in STREETS]} if REAL.is_dir() else {}
    groups |= {one.name: sorted(one.iterdir()) for one in static or STATIC if one.is_dir()}
    if groups:
        blocks += ["Real photographs:", still_lines(groups, network)]
    publish(joined(*blocks), out)


if __name__ == "__main__":
    run(main)
