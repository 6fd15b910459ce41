r"""Whether smears put photographs in the order of their blur, and what blur costs their features.

    python -m tools.evaluation.triage render/test --photos KODAK --out tools/results/triage.md

Order: Spearman's rank correlation with the true median smear, of the measured median smear and of the
variance of the Laplacian (OpenCV, grey, as ``colmap2nerf.py`` of instant-ngp has it), over the photographs of
a test set, and over these and the sharp first instants of the same scenes, whose smear is zero. Features: the
share of SIFT features of sharp photographs that are matched, within 3 px of their place, after an even blur,
over the share without blur under fresh noise.
"""

import cv2
import numpy as np
from scipy.stats import spearmanr

import blur2view
from blur2view.arrays import AnyArray
from blur2view.smears.blur import blur_of
from tools.arguments import Existing, Target, run
from tools.datasets.blurred_photographs import photographs_of, radiance_of, smeared, taken
from tools.datasets.testset import read_test_set
from tools.evaluation.blur_kinds import laplacian_variance
from tools.pages import publish, table

LENGTHS_PX = (0, 1, 2, 3, 4, 5, 6, 8, 10, 14, 20)
NEAR_PX = 3.0
RATIO = 0.8  # of the second-best distance, Lowe's


def grey_picture(rng: np.random.Generator, light: AnyArray, length_px: float) -> AnyArray:
    """Return the photograph (H, W), uint8 grey, of linear light under an even smear."""
    picture = next(taken(rng, smeared(rng, light, length_px)[0], kind=blur2view.BlurKind.CAMERA_MOVED))
    return np.asarray(cv2.imdecode(np.frombuffer(picture.file, np.uint8), cv2.IMREAD_GRAYSCALE))


def matched_share(sharp: AnyArray, other: AnyArray) -> float:
    """Return the share of the SIFT features of a picture that are matched at their place in another."""
    sift = cv2.SIFT.create()
    (first, described), (second, others) = (sift.detectAndCompute(one, None) for one in (sharp, other))
    if described is None or others is None or len(others) < 2:
        return 0.0
    pairs = cv2.BFMatcher().knnMatch(described, others, k=2)
    good = [best for best, next_best in pairs if best.distance < RATIO * next_best.distance]
    places = np.array([np.subtract(first[m.queryIdx].pt, second[m.trainIdx].pt) for m in good]).reshape(-1, 2)
    return float((np.linalg.norm(places, axis=1) < NEAR_PX).sum() / len(first))


def features_left(folders: list[Existing]) -> AnyArray:
    """Return the median share (lengths,) of features that are left after every blur, over that without."""
    rng, rows = np.random.default_rng(0), []
    for light in map(radiance_of, photographs_of(folders)):
        sharp = grey_picture(rng, light, 0)
        shares = [matched_share(sharp, grey_picture(rng, light, length_px)) for length_px in LENGTHS_PX]
        if shares[0] > 0:
            rows.append(np.divide(shares, shares[0]))
    return np.asarray(np.median(rows, axis=0))


def main(scenes: Existing, *, photos: list[Existing] | None = None, out: Target | None = None) -> None:
    """Order a test set, with its sharp first instants, too, and count features of photographs in folders."""
    network, figures = blur2view.SmearNetwork(), []
    for end in ("", "_open"):  # as the shutter opened: sharp
        for scene in read_test_set(scenes):
            image = blur2view.read_image(scene.image_path.with_name(f"{scene.name}{end}.png"))
            true_px, smear_px = 0.0 if end else scene.median_px, blur_of(network.predict(image)).smear_px
            figures.append((true_px, smear_px or 0.0, -laplacian_variance(image)))  # which blur lowers
    order = []
    groups = {"rendered": figures[: len(figures) // 2], "rendered, and their sharp first instants": figures}
    for name, some in groups.items():
        true, *others = np.transpose(some)
        order.append((name, len(some), *(f"{spearmanr(true, one).statistic:.3f}" for one in others)))
    left = [[f"{share:.2f}" for share in features_left(photos)]] if photos else []
    publish(
        out,
        "# Triage",
        "Rank correlation with the true median smear:",
        table("photographs | number | median smear | variance of the Laplacian", order),
        "SIFT features left after an even blur, over those left without:",
        table(" | ".join(f"{px} px" for px in LENGTHS_PX), left),
    )


if __name__ == "__main__":
    run(main)
