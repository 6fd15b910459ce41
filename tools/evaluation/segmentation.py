"""How good motion masks are: rendered photographs with movers and without, and real ones.

``python -m tools.evaluation.segmentation render/test render/movers --out tools/results/segmentation`` writes
``segmentation.md`` (the table) and ``segmentation.webp`` (some scenes: photograph with the truth,
probability, mask). Truth and masks are compared at the centres of the truth's cells, 4 x 4 pixels, where
smears are known. The scenes of one folder count as one split: `tools.datasets.testset` makes the test split,
`tools.datasets.mover_scenes` another with a mover in every picture.
"""

import json
import shlex
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from blur2view.arrays import AnyArray
from blur2view.geometry.sampson import serrmin
from blur2view.movers.camera_motion import Cells
from blur2view.networks.smear_network import SmearNetwork
from blur2view.photographs.image import read_image
from blur2view.pipeline import Estimate, estimate
from blur2view.results.mask_overlay import draw_motion
from blur2view.segmentation.mask import MotionLabel, MotionMask, segment
from blur2view.smears.field import smear_ends, upsample_grid
from tools.arguments import existing, parser_of, target
from tools.datasets.testset import TestScene, read_test_set
from tools.pages import publish, table, write_picture
from tools.rendering.exposure import GRID

Mask = NDArray[np.bool_]

REAL = Path("../shared/data/real")
OUTLINE = Path("tests/support/local_walker_0083.json")
STREETS = ("gopro_street_01.png", "gopro_street_07.png")  # nothing in them moves
STATIC = [Path("../shared/data/redkitchen"), Path("../shared/data/textures/kodak")]
LEAST_SHARE = 0.01  # of the picture that moves, for a scene to count as one with movers
FALSE_SHARE = 0.005  # called moving where nothing moves: more is a miss
CLEAR_PX = 4.0  # difference of a mover's smear from those around it that is plain to see


@dataclass(frozen=True, kw_only=True)
class SceneFigures:
    """One scene: what moves, what was called moving, and how well the probability ranks.

    Of scenes without movers only ``called`` and the counts have a meaning; the others may be NaN, as where a
    method calls every pixel of a mover unobservable. ``recall`` is that of movers at least twice as wide as
    their smear, which differs from the camera's by 4 px or more. ``counts`` (2, 10) are all pixels, and those
    that move, by tenths of the probability.
    """

    share: float
    iou: float
    iou_everywhere: float
    precision: float
    precision_everywhere: float
    precision_baseline: float
    recall: float
    called: float
    unobservable: float
    counts: AnyArray


COLUMNS = [field.name for field in fields(SceneFigures)][1:-1]


def average_precision(score: AnyArray, moving: Mask) -> float:
    """Return the mean precision at every moving pixel, ranked by score: 1 if all of them come first.

    Equal scores share the precision at their end.
    """
    if not moving.any():
        return float("nan")
    order = np.argsort(-score, kind="stable")
    ranked, truth = score[order], moving[order]
    last = np.searchsorted(-ranked, -ranked, side="right")  # of those that are equal
    return float((np.cumsum(truth)[last - 1] / last)[truth].mean())


def overlap(found: Mask, true: Mask) -> float:
    """Return the intersection over union; NaN where both are empty."""
    union = (found | true).sum()
    return float((found & true).sum() / union) if union else float("nan")


def judge(scene: TestScene, found: Estimate, mask: MotionMask) -> SceneFigures:
    """Return how a mask compares with the truth, and how well SErrMin ranks the same."""
    shape = scene.valid.shape
    rows, columns = np.ix_(*(np.minimum(GRID * np.arange(n) + 1, side - 1)
                             for n, side in zip(shape, mask.labels.shape, strict=True)))  # fmt: skip
    label, score = mask.labels[rows, columns], mask.probability[rows, columns]
    valid, moving = scene.valid, ~scene.static & scene.valid
    called = (label == MotionLabel.MOVING) & valid
    seen = (label != MotionLabel.UNOBSERVABLE) & valid
    plain = squared_residual(found, shape)
    clear = clear_movers(scene)
    tenth = np.minimum((10 * score[valid]).astype(int), 9)
    return SceneFigures(
        share=float(moving.mean()),
        iou=overlap(called[seen], moving[seen]) if moving[seen].any() else float("nan"),
        iou_everywhere=overlap(called, moving),
        precision=average_precision(score[seen], moving[seen]),
        precision_everywhere=average_precision(score[valid], moving[valid]),
        recall=float(called[clear].mean()) if clear.any() else float("nan"),
        called=float(called.sum() / valid.sum()),
        unobservable=float(1 - seen.sum() / valid.sum()),
        precision_baseline=average_precision(plain[valid], moving[valid]),
        counts=np.stack([np.bincount(tenth, minlength=10), np.bincount(tenth, moving[valid], minlength=10)]),
    )


def clear_movers(scene: TestScene) -> Mask:
    """Mark what moves, is at least twice as wide as its smear is long, and smears 4 px off what is around it.

    Around it is what stands still and is nearest.
    """
    moving = ~scene.static & scene.valid
    if not moving.any() or not (scene.static & scene.valid).any():
        return np.zeros_like(moving)
    own = np.nan_to_num(scene.displacement)
    length = np.linalg.norm(own, axis=-1)
    still = scene.static & scene.valid
    nearest = distance_transform_edt(~still, return_distances=False, return_indices=True)
    around = own[nearest[0], nearest[1]]
    apart = np.minimum(*(np.linalg.norm(own - sign * around, axis=-1) for sign in (1, -1)))
    clear = np.zeros_like(moving)
    _, part, stats, _ = cv2.connectedComponentsWithStats((~scene.static).astype(np.uint8))
    for k in range(1, len(stats)):
        inside = (part == k) & moving
        width = GRID * 2 * float(distance_transform_edt(np.pad(part == k, 1)).max())
        if inside.any() and width >= 2 * np.median(length[inside]) and np.median(apart[inside]) >= CLEAR_PX:
            clear |= inside
    return clear


def squared_residual(found: Estimate, shape: tuple[int, ...]) -> AnyArray:
    """Return SErrMin of the cells on the truth's grid (h, w); without F half the squared length."""
    assert found.grid is not None
    cells, F = Cells.of(found.grid), found.geometry.F
    ends = smear_ends(cells.points.reshape(-1, 2), cells.displacement.reshape(-1, 2))
    plain = 0.5 * cells.length_px**2 if F is None else serrmin(F, ends).reshape(cells.sigma_px.shape)
    fine = upsample_grid(plain[..., None].astype(np.float32), max(found.grid.stride // GRID, 1))
    return np.asarray(fine[: shape[0], : shape[1], 0])


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """A scene with its mask and figures."""

    scene: TestScene
    image: NDArray[np.float32]
    mask: MotionMask
    figures: SceneFigures


def judged_scenes(folders: Iterable[Path], network: SmearNetwork) -> Iterator[tuple[Path, Judged]]:
    """Yield every scene of every folder, segmented."""
    for folder in folders:
        for scene in read_test_set(folder):
            found = estimate(image := read_image(scene.image_path), network=network)
            mask = segment(found, image)
            figures = judge(scene, found, mask)
            yield folder, Judged(scene=scene, image=image, mask=mask, figures=figures)


def split_rows(name: str, judged: list[Judged]) -> list[tuple[str, ...]]:
    """Return rows of a split: scenes with movers, scenes without any."""
    some = [one.figures for one in judged if one.figures.share >= LEAST_SHARE]
    still = [one.figures for one in judged if one.scene.static.all()]
    many = sum(scene.called > FALSE_SHARE for scene in still)
    return [
        _row(f"{name}, movers of 1 % or more", some),
        _row(f"{name}, no movers ({many} over {FALSE_SHARE:.1%})", still),
    ]


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


def real_lines(folder: Path, static: list[Path], network: SmearNetwork) -> list[str]:
    """Return the overlap with the outlined walker, and what is called moving where nothing is."""
    outline = json.loads(OUTLINE.read_text())
    person = np.zeros((outline["height"], outline["width"]), np.uint8)
    cv2.fillPoly(person, [np.array(outline["polygon"], np.int32)], 1)
    moving = moving_in(folder / outline["photograph"], network)
    elsewhere = float((moving & ~cv2.dilate(person, np.ones((41, 41), np.uint8)).astype(bool)).mean())
    lines = [
        f"- {outline['photograph']}: IoU {overlap(moving, person > 0):.2f} with the outlined person; "
        f"{elsewhere:.1%} of the picture called moving more than 20 px from it"
    ]
    groups = {"streets": [folder / name for name in STREETS]}
    groups |= {one.name: sorted(one.iterdir()) for one in static if one.is_dir()}
    for name, paths in groups.items():
        pictures = [path for path in paths if path.suffix in (".jpg", ".png")]
        shares = np.array([moving_in(path, network).mean() for path in pictures])
        lines.append(
            f"- {name}, {len(shares)} photographs in which nothing moves: {shares.mean():.2%} called moving, "
            f"{shares.max():.2%} at most, more than {FALSE_SHARE:.1%} in {(shares > FALSE_SHARE).sum()}"
        )
    return lines


def moving_in(photo: Path, network: SmearNetwork) -> Mask:
    """Return what of a photograph is called moving."""
    image = read_image(photo)
    return np.asarray(segment(estimate(image, network=network), image).labels == MotionLabel.MOVING)


def panel(judged: list[Judged], rows: int = 8) -> AnyArray:
    """Return scenes, evenly from the best mask to the worst, a row each (:func:`_panel_row`)."""
    some = sorted(judged, key=lambda one: -np.nan_to_num(one.figures.iou))
    chosen = [some[k] for k in np.unique(np.linspace(0, len(some) - 1, min(rows, len(some))).astype(int))]
    return np.vstack([_panel_row(one) for one in chosen])


def _panel_row(one: Judged) -> AnyArray:
    height, width = one.image.shape[:2]
    photo = np.round(255 * one.image).astype(np.uint8)
    truth = cv2.resize((~one.scene.static).astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    rims, _ = cv2.findContours(truth, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(photo, rims, -1, (255, 70, 170), 2)
    level = np.round(255 * one.mask.probability).astype(np.uint8)
    heat = cv2.applyColorMap(level, cv2.COLORMAP_VIRIDIS)[..., ::-1]
    drawn = draw_motion(one.image, one.mask)[:height, :width]
    row = np.hstack([photo, heat, drawn])
    return np.asarray(cv2.resize(row, (row.shape[1] // 2, row.shape[0] // 2), interpolation=cv2.INTER_AREA))


HEAD = """# Motion masks

`{command}`; network `{model}`.

Means over scenes. IoU of what is called moving with what moves, and average precision of the probability,
over pixels that are not called unobservable, and everywhere that smears are known; baseline: SErrMin of the
same F. Recall of movers at least twice as wide as their smear, which differs by 4 px or more from what stands
still beside them.

"""


def tables(folders: dict[Path, list[Judged]]) -> list[str]:
    """Return the rows of every folder under their heads, and the calibration over all."""
    rows = [row for folder, judged in folders.items() for row in split_rows(folder.name, judged)]
    figures = [one.figures for judged in folders.values() for one in judged]
    words = "Calibration, all pixels of all scenes:"
    return [*table(f"scenes | n | {' | '.join(COLUMNS)}", rows), "", words, "", *calibration_lines(figures)]


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("scenes", type=existing, nargs="+", help="folders of rendered scenes")
    parser.add_argument("--real", type=Path, default=REAL, help="folder of the real photographs")
    parser.add_argument("--static", type=Path, nargs="+", default=STATIC, help="folders of still photographs")
    parser.add_argument("--out", type=target, required=True, help="without suffix")
    arguments = parser.parse_args()
    network = SmearNetwork()
    judged: dict[Path, list[Judged]] = {folder: [] for folder in arguments.scenes}
    for folder, one in judged_scenes(arguments.scenes, network):
        judged[folder].append(one)
    command = f"python -m tools.evaluation.segmentation {shlex.join(sys.argv[1:])}"
    lines = tables(judged)
    if arguments.real.is_dir():
        lines += ["", "Real photographs:", "", *real_lines(arguments.real, arguments.static, network)]
    text = HEAD.format(command=command, model=network.info.model_id) + "\n".join(lines) + "\n"
    publish(text, arguments.out.with_suffix(".md"))
    some = [one for split in judged.values() for one in split if one.figures.share >= LEAST_SHARE]
    if some:
        write_picture(arguments.out.with_suffix(".webp"), panel(some))


if __name__ == "__main__":
    main()
