r"""Whether smears put photographs in the order of their blur, and what blur costs their features.

    python -m tools.benchmarks.triage render/test --photos KODAK/train KODAK/held \
        --out tools/results/triage.md

writes a table of two parts. Order: Spearman's rank correlation with the true median smear, of our median
smear and of the variance of the Laplacian (OpenCV, grey, as ``colmap2nerf.py`` of instant-ngp has it), over
the photographs of a test set, and over these and the sharp first instants of the same scenes, whose smear is
zero. Features: the share of SIFT features of sharp photographs that are matched, within 3 px of their place,
after an even blur, over the share without blur under fresh noise; the limit is the longest blur at which half
are left in the first folder.
"""

from pathlib import Path

import cv2
import numpy as np
from scipy.stats import spearmanr

import blur2view
from blur2view.arrays import AnyArray, Array
from blur2view.smears.blur import blur_of
from tools.arguments import Existing, Target, run
from tools.datasets.testset import read_test_set
from tools.evaluation.blur_kinds import laplacian_variance
from tools.evaluation.even_blur import blurred, middles
from tools.pages import joined, publish, table

LENGTHS_PX = (0, 1, 2, 3, 4, 5, 6, 8, 10, 14, 20)
NEAR_PX = 3.0
RATIO = 0.8  # of the second-best distance, Lowe's


def matched_share(sharp: AnyArray, other: AnyArray) -> float:
    """Return the share of the SIFT features of a picture that are matched at their place in another."""
    sift = cv2.SIFT.create()
    found = [sift.detectAndCompute((one * 255).round().astype(np.uint8), None) for one in (sharp, other)]
    (first, described), (second, others) = found
    if described is None or others is None or len(others) < 2:
        return 0.0
    pairs = cv2.BFMatcher().knnMatch(described, others, k=2)
    good = [best for best, next_best in pairs if best.distance < RATIO * next_best.distance]
    places = np.array([np.subtract(first[m.queryIdx].pt, second[m.trainIdx].pt) for m in good]).reshape(-1, 2)
    return float((np.linalg.norm(places, axis=1) < NEAR_PX).sum() / len(first))


def features_left(folder: Path) -> Array:
    """Return the median share (lengths,) of features that are left after every blur, over that without."""
    rng, rows = np.random.default_rng(0), []
    for radiance in middles([folder]):
        angle = float(rng.uniform(0, np.pi))
        sharp = blurred(rng, radiance, 0, angle, False)
        pictures = (blurred(rng, radiance, length_px, angle, False) for length_px in LENGTHS_PX)
        shares = [matched_share(sharp, picture) for picture in pictures]
        if shares[0] > 0:
            rows.append(np.divide(shares, shares[0]))
    return np.asarray(np.median(rows, axis=0))


def limit_of(left: Array) -> int:
    """Return the longest blur, pixels, up to which half of the features are left."""
    return max(length_px for length_px, share in zip(LENGTHS_PX, left, strict=True) if share >= 0.5)


def main(scenes: Existing, *, photos: list[Existing] | None = None, out: Target | None = None) -> None:
    """Order a test set, with its sharp first instants, too, and count features of photographs in folders."""
    network, said = blur2view.SmearNetwork(), []
    for end in ("", "_open"):  # as the shutter opened: sharp
        for scene in read_test_set(scenes):
            image = blur2view.read_image(scene.image_path.with_name(f"{scene.name}{end}.png"))
            true_px, smear_px = 0.0 if end else scene.median_px, blur_of(network.predict(image)).smear_px
            said.append((true_px, smear_px or 0.0, -laplacian_variance(image)))  # which blur lowers
    order, smeared = [], said[: len(said) // 2]
    for name, some in {"rendered": smeared, "rendered, and their sharp first instants": said}.items():
        true, *others = np.transpose(some)
        order.append((name, len(some), *(f"{spearmanr(true, one).statistic:.3f}" for one in others)))
    features = {folder.name: features_left(folder) for folder in photos or ()}
    left = [(k, *(f"{x:.2f}" for x in one), f"{limit_of(one)} px") for k, one in features.items()]
    lengths = " | ".join(f"{px} px" for px in LENGTHS_PX)
    text = joined(
        "# Triage",
        "Rank correlation with the true median smear:",
        table("photographs | number | median smear | variance of the Laplacian", order),
        "SIFT features left after an even blur, over those left without:",
        table(f"photographs | {lengths} | half left up to", left),
    )
    publish(text, out)


if __name__ == "__main__":
    run(main)
