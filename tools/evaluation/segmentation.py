"""How good motion masks are: rendered photographs with movers and without, and real ones.

``python -m tools.evaluation.segmentation render/test render/movers --out tools/results/segmentation`` writes
``segmentation.md`` (the table) and ``segmentation.webp`` (some scenes: photograph with the truth, score,
probability, mask). Truth and masks are compared at the centres of the truth's cells, 4 x 4 pixels, where
smears are known. The scenes of one folder count as one split: `tools.datasets.testset` makes the test split,
`tools.datasets.mover_scenes` another with a mover in every picture.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from blur2view.arrays import AnyArray
from blur2view.camera.image import read_image
from blur2view.geometry.sampson import serrmin
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import Estimate, estimate
from blur2view.segmentation.mask import MotionLabel, MotionMask, segment
from blur2view.smears.field import SmearField, smear_ends
from blur2view.smears.selection import grid_pixels, select_matches
from blur2view.two_view.estimate import estimate_two_view
from blur2view.visualization.mask_overlay import draw_motion
from tools.arguments import existing, target
from tools.datasets.testset import TestScene, read_test_set
from tools.reports.figure_style import save_picture

Mask = NDArray[np.bool_]

REAL = Path("../shared/data/real")
OUTLINE = Path("tests/support/local_walker_0083.json")
STREETS = ("gopro_street_01.png", "gopro_street_07.png")  # nothing in them moves
STATIC = Path("../shared/data/redkitchen")
SEEDS = 4
LEAST_SHARE = 0.01  # of the picture that moves, for a scene to count as one with movers
LARGE_SHARE = 0.05
BASELINE = 3.0  # squared pixels: the paper's threshold on SErrMin
TRUE_SIGMA_PX = 0.5


@dataclass(frozen=True, kw_only=True)
class SceneFigures:
    """One scene: what moves, what was called moving, and how well the evidence ranks.

    Of scenes without movers only ``called`` has a meaning; the others may be NaN, as where a method calls
    every pixel of a mover unobservable.
    """

    name: str
    share: float
    iou: float
    iou_everywhere: float
    precision: float
    called: float
    unobservable: float
    iou_baseline: float
    precision_baseline: float
    called_baseline: float


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
    """Return how a mask compares with the truth, and SErrMin above BASELINE with the same."""
    shape, (rows, columns) = scene.valid.shape, grid_pixels(found.field.shape)
    label, score = (field[rows, columns].reshape(shape) for field in (mask.labels, mask.score))
    valid, moving = scene.valid, ~scene.static & scene.valid
    called = (label == MotionLabel.MOVING) & valid
    seen = (label != MotionLabel.UNOBSERVABLE) & valid
    plain = squared_residual(found)[rows, columns].reshape(shape)
    plain_called = (plain > BASELINE) & valid
    return SceneFigures(
        name=scene.name,
        share=float(moving.mean()),
        iou=overlap(called[seen], moving[seen]) if moving[seen].any() else float("nan"),
        iou_everywhere=overlap(called, moving),
        precision=average_precision(score[seen], moving[seen]),
        called=float(called.sum() / valid.sum()),
        unobservable=float(1 - seen.sum() / valid.sum()),
        iou_baseline=overlap(plain_called, moving),
        precision_baseline=average_precision(plain[valid], moving[valid]),
        called_baseline=float(plain_called.sum() / valid.sum()),
    )


def squared_residual(found: Estimate) -> AnyArray:
    """Return SErrMin at every pixel (H, W); without F half the squared length."""
    field, F = found.field, found.geometry.F
    if F is None:
        return np.asarray(0.5 * field.length_px**2)
    rows, columns = np.indices(field.shape)
    points = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    return serrmin(F, smear_ends(points, field.displacement.reshape(-1, 2))).reshape(field.shape)


def true_estimate(scene: TestScene, found: Estimate) -> Estimate:
    """Return the estimate from the true smears; where they are unknown, from the nearest known."""
    nearest = distance_transform_edt(~scene.valid, return_distances=False, return_indices=True)
    grid = scene.displacement[nearest[0], nearest[1]].astype(np.float32)
    size = found.field.shape[::-1]
    displacement = cv2.resize(grid, size, interpolation=cv2.INTER_NEAREST)
    sigma_px = np.full(found.field.shape, TRUE_SIGMA_PX, np.float32)
    length = np.maximum(np.hypot(displacement[..., 0], displacement[..., 1]), TRUE_SIGMA_PX)
    field = SmearField(displacement=displacement, sigma_px=sigma_px, sigma_rad=TRUE_SIGMA_PX / length)
    matches = select_matches(field)
    geometry = estimate_two_view(matches, rng=np.random.default_rng(0))
    return replace(found, field=field, matches=matches, geometry=geometry)


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """A scene with its figures, by predicted smears and by true ones."""

    scene: TestScene
    image: NDArray[np.float32]
    mask: MotionMask
    predicted: SceneFigures
    true: SceneFigures


def judged_scenes(folders: Iterable[Path], network: SmearNetwork) -> Iterator[tuple[Path, Judged]]:
    """Yield every scene of every folder, segmented."""
    for folder in folders:
        for scene in read_test_set(folder):
            image = read_image(scene.image_path)
            found = estimate(image, network=network)
            mask = segment(found)
            truly = true_estimate(scene, found)
            yield (
                folder,
                Judged(
                    scene=scene,
                    image=image,
                    mask=mask,
                    predicted=judge(scene, found, mask),
                    true=judge(scene, truly, segment(truly)),
                ),
            )


def mean(scenes: Iterable[SceneFigures], value: Callable[[SceneFigures], float]) -> float:
    """Return the mean over scenes, those without a value left out."""
    values = np.array([value(scene) for scene in scenes], float)
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def split_rows(name: str, judged: list[Judged]) -> list[str]:
    """Return rows of a split: predicted and true smears, all movers and large ones, scenes without any."""
    kinds = {"predicted": "predicted smears", "true": "true smears"}
    rows = []
    for least, what in ((LEAST_SHARE, "1 %"), (LARGE_SHARE, "5 %")):
        for kind, said in kinds.items():
            some = [getattr(one, kind) for one in judged if one.predicted.share >= least]
            rows.append(_row(f"{name}, movers of {what} or more, {said}", some))
    still = [one for one in judged if not (~one.scene.static).any()]
    for kind, said in kinds.items():
        rows.append(_row(f"{name}, no movers, {said}", [getattr(one, kind) for one in still]))
    return rows


def _row(name: str, scenes: list[SceneFigures]) -> str:
    figures = [
        mean(scenes, lambda s: s.iou),
        mean(scenes, lambda s: s.iou_everywhere),
        mean(scenes, lambda s: s.iou_baseline),
        mean(scenes, lambda s: s.precision),
        mean(scenes, lambda s: s.precision_baseline),
        mean(scenes, lambda s: s.called),
        mean(scenes, lambda s: s.called_baseline),
        mean(scenes, lambda s: s.unobservable),
    ]
    cells = " | ".join("-" if np.isnan(figure) else f"{figure:.3f}" for figure in figures)
    return f"| {name} | {len(scenes)} | {cells} |"


def real_lines(folder: Path, static: Path, network: SmearNetwork) -> list[str]:
    """Return the overlap with the outlined walker, and what is called moving where nothing is."""
    outline = json.loads(OUTLINE.read_text())
    person = np.zeros((outline["height"], outline["width"]), np.uint8)
    cv2.fillPoly(person, [np.array(outline["polygon"], np.int32)], 1)
    image = read_image(folder / outline["photograph"])
    moving = segment(estimate(image, network=network)).labels == MotionLabel.MOVING
    elsewhere = float((moving & ~cv2.dilate(person, np.ones((41, 41), np.uint8)).astype(bool)).mean())
    lines = [
        f"- {outline['photograph']}: IoU {overlap(moving, person > 0):.2f} with the outlined person; "
        f"{elsewhere:.1%} of the picture called moving more than 20 px from it"
    ]
    for name in STREETS:
        each = ", ".join(f"{share:.1%}" for share in false_shares(folder / name, network, range(SEEDS)))
        lines.append(f"- {name}: {each} of the street called moving (seeds 0 to {SEEDS - 1})")
    shares = [false_shares(path, network, range(1))[0] for path in sorted(static.glob("*.jpg"))]
    if shares:
        many = sum(share > LEAST_SHARE for share in shares)
        lines.append(
            f"- {static.name}, {len(shares)} frames in which nothing moves: {np.mean(shares):.2%} called "
            f"moving, more than {LEAST_SHARE:.0%} in {many}"
        )
    return lines


def false_shares(photo: Path, network: SmearNetwork, seeds: Iterable[int]) -> list[float]:
    """Return the shares of a photograph, in which nothing moves, that are called moving with some seeds."""
    image = read_image(photo)
    shares = []
    for seed in seeds:
        found = estimate(image, network=network, rng=np.random.default_rng(seed))
        mask = segment(found, rng=np.random.default_rng(seed))
        shares.append(float((mask.labels == MotionLabel.MOVING).mean()))
    return shares


def with_movers(judged: Iterable[Judged]) -> list[Judged]:
    """Return the scenes that count as ones with movers."""
    return [one for one in judged if one.predicted.share >= LEAST_SHARE]


def panel(judged: list[Judged], rows: int = 8) -> AnyArray:
    """Return scenes, evenly from the best mask to the worst, a row each (:func:`_panel_row`)."""
    some = sorted(judged, key=lambda one: -np.nan_to_num(one.predicted.iou))
    chosen = [some[k] for k in np.unique(np.linspace(0, len(some) - 1, min(rows, len(some))).astype(int))]
    return np.vstack([_panel_row(one) for one in chosen])


def _panel_row(one: Judged) -> AnyArray:
    """Return photograph with the truth outlined, square root of the score to 5, probability, mask."""
    height, width = one.image.shape[:2]
    photo = np.round(255 * one.image).astype(np.uint8)
    truth = cv2.resize((~one.scene.static).astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    rims, _ = cv2.findContours(truth, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(photo, rims, -1, (255, 255, 255), 3)
    cv2.drawContours(photo, rims, -1, (255, 70, 170), 1)
    shares = np.clip(np.sqrt(one.mask.score) / 5, 0, 1), one.mask.probability
    heats = [
        cv2.applyColorMap(np.round(255 * share).astype(np.uint8), cv2.COLORMAP_VIRIDIS)[..., ::-1]
        for share in shares
    ]
    drawn = draw_motion(one.image, one.mask)[:height, :width]
    row = np.hstack([photo, *heats, drawn])
    return np.asarray(cv2.resize(row, (row.shape[1] // 2, row.shape[0] // 2), interpolation=cv2.INTER_AREA))


HEAD = """# Motion masks

`{command}`; network `{model}`.

Means over scenes. IoU: of what is called moving with what moves, over the pixels that are not called
unobservable; "all": over every pixel whose smear is known. Baseline: SErrMin of the same F above 3 squared
pixels. AP: average precision of the scores. "True smears": the same with the truth in place of the smears.

| scenes | n | IoU | IoU, all | IoU, baseline | AP | AP, SErrMin | called moving | baseline | unobservable |
|---|---|---|---|---|---|---|---|---|---|
"""


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", type=existing, nargs="+", help="folders of rendered scenes")
    parser.add_argument("--real", type=Path, default=REAL, help="folder of the real photographs")
    parser.add_argument("--static", type=Path, default=STATIC, help="folder of frames in which nothing moves")
    parser.add_argument("--out", type=target, required=True, help="without suffix")
    arguments = parser.parse_args()
    network = SmearNetwork()
    judged: dict[Path, list[Judged]] = {folder: [] for folder in arguments.scenes}
    for folder, one in judged_scenes(arguments.scenes, network):
        judged[folder].append(one)
        print(folder.name, one.predicted, flush=True)
    rows = [row for folder, some in judged.items() for row in split_rows(folder.name, some)]
    folders = " ".join(map(str, arguments.scenes))
    command = f"python -m tools.evaluation.segmentation {folders} --out {arguments.out}"
    text = HEAD.format(command=command, model=network.info.model_id) + "\n".join(rows) + "\n"
    if arguments.real.is_dir():
        text += (
            "\nReal photographs:\n\n"
            + "\n".join(real_lines(arguments.real, arguments.static, network))
            + "\n"
        )
    arguments.out.with_suffix(".md").write_text(text)
    some = with_movers(one for some in judged.values() for one in some)
    if some:
        save_picture(panel(some), arguments.out.with_suffix(".webp"))


if __name__ == "__main__":
    main()
