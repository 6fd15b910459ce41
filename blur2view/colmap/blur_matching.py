"""Patches of two photographs found in each other, each blurred by the other's smear.

Blurs commute: S * k blurred by l is S * l blurred by k. Then ordinary registration (pyramidal Lucas-Kanade,
Bouguet 2001) works to a fraction of a pixel, where features of SIFT are not found again. It is done in
linear light: in the file's gamma residuals along the smears of RedKitchen are twice as large.
"""

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array

GAMMA = 2.2  # of stored pixels
HALF_PATCH = 14  # pixels; patches of 29 px
SAMPLE_STEP = 2  # pixels from one sample of a patch to the next where two are compared
SAMPLE_PX, MOST_SAMPLES = 1.5, 24  # of a smear's length to each sample of it; and at most so many
LEAST_PX = 0.5  # of a smear that blurs
LONGEST_SHARE = 0.97  # of a picture's smears; what is longer is shortened to that
CONTRAST_WINDOW = 61  # pixels over which brightness and contrast are made equal
CONTRAST, GREY, NOISE = 40.0, 128.0, 2.0  # of 8 bits, after which LK of OpenCV asks; levels of noise
MOST_BACK_PX = 0.5  # from where a patch started to where it is found again
UNFOUND = 1e4  # pixels


def linear_light(image: Any) -> Any:
    """Return a photograph, (H, W, 3) or (H, W) with white 1, as linear grey, 0 to 255, float32."""
    grey: Any = np.asarray(image, np.float32)
    if grey.ndim == 3:
        grey = cv2.cvtColor(np.ascontiguousarray(grey[..., :3]), cv2.COLOR_RGB2GRAY)
    return np.float32(255) * np.maximum(grey, 0) ** np.float32(GAMMA)


def resampled(image: Any, place: Any, how: int = cv2.INTER_LINEAR) -> Any:
    """Return an image (H, W, ...) at the pixels of a map (h, w, 2), float32: (h, w, ...), mirrored beyond."""
    remap: Any = cv2.remap  # whose stubs want two maps
    values = remap(image, place, None, how, borderMode=cv2.BORDER_REFLECT)
    return values.reshape(*place.shape[:2], *image.shape[2:])


def blurred_along(image: Any, path: Any, bend: Any = None, moments: bool = False) -> list[Any]:
    """Return an image (H, W, ...) blurred along path t + bend t^2, (H, W, 2), t from -1/2 to 1/2.

    A list of this image and, with ``moments``, of those whose samples are weighed by t and t^2.
    """
    height, width = image.shape[:2]
    place = np.dstack(np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)))
    length = np.hypot(path[..., 0], path[..., 1])
    longest = float(np.quantile(length[::8, ::8], LONGEST_SHARE))
    path = path * np.minimum(1, np.float32(longest) / np.maximum(length, np.float32(TINY)))[..., None]
    count = int(np.clip(np.ceil(longest / SAMPLE_PX), 2, MOST_SAMPLES)) if longest > LEAST_PX else 1
    sums = [np.zeros_like(image, np.float32) for _ in range(3 if moments else 1)]
    seen = np.empty_like(place)
    for t in (np.arange(count, dtype=np.float32) + 0.5) / np.float32(count) - np.float32(0.5):
        cv2.scaleAdd(path, -t, place, seen)
        if bend is not None:
            cv2.scaleAdd(bend, -t * t, seen, seen)
        sample = resampled(image, seen)
        for power, total in enumerate(sums):
            cv2.scaleAdd(sample, t**power, total, total)
    return [total / np.float32(count) for total in sums]


def equalised(image: Any) -> Any:
    """Return an image, float32, with the same mean and contrast everywhere, uint8, for OpenCV's tracker."""
    window = (CONTRAST_WINDOW, CONTRAST_WINDOW)
    mean = cv2.blur(image, window)
    spread = np.sqrt(np.maximum(cv2.blur(image * image, window) - mean * mean, 0) + NOISE**2)
    return np.clip((image - mean) / spread * CONTRAST + GREY, 0, 255).astype(np.uint8)


def tracked(first: Any, second: Any, points: Array, moved: Array, levels: int) -> Array:
    """Return how far patches at (N, 2) moved between uint8 images, (N, 2), about ``moved``, or `UNFOUND`."""
    if not len(points):
        return np.zeros((0, 2))
    start = np.array(points, np.float32).reshape(-1, 1, 2)
    guess = np.array(points + moved, np.float32).reshape(-1, 1, 2)
    side = 2 * HALF_PATCH + 1
    found, good, _ = cv2.calcOpticalFlowPyrLK(
        first, second, start, guess, winSize=(side, side), maxLevel=levels,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW, minEigThreshold=1e-5,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.005),
    )  # fmt: skip
    return np.where(good == 1, (found - start)[:, 0].astype(float), UNFOUND)


def patches(image: Any, points: Array) -> Any:
    """Return patches (N, M, ...) of an image about points (N, 2), less their mean, float32."""
    steps = np.arange(-HALF_PATCH, HALF_PATCH + 1, SAMPLE_STEP, dtype=np.float32)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    values = resampled(image, np.asarray(points, np.float32)[:, None] + offsets)
    return values - values.mean(axis=1, keepdims=True)


def gradients(image: Any) -> Any:
    """Return the derivatives of an image by x and y, (H, W, 2)."""
    return np.dstack([cv2.Sobel(image, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1))])


class PatchMatches(NamedTuple):
    """Patches of one image at the points found in another."""

    moved: Array  # (N, 2) from the point in the first image to its place in the second, pixels
    correlation: Array  # (N,) normalised, -1 to 1
    covariance: Array  # (N, 2, 2) of ``moved``, pixels^2: long along an edge or a smear
    found: NDArray[np.bool_]  # (N,) found again from the other image, `MOST_BACK_PX` from the point


def match_patches(first: Any, second: Any, points: Array, levels: int) -> PatchMatches:
    """Return where patches of one float32 image at points (N, 2) lie in another that is about aligned."""
    one, other = equalised(first), equalised(second)
    moved = tracked(one, other, points, np.zeros_like(points), levels)
    back = tracked(other, one, points + moved, -moved, 0)
    found = np.linalg.norm(moved + back, axis=1) < MOST_BACK_PX
    moved = np.where(found[:, None], moved, 0.0)
    one, other = one.astype(np.float32), other.astype(np.float32)
    here, there = patches(one, points), patches(other, points + moved)
    energy, other_energy = (here * here).sum(axis=1), (there * there).sum(axis=1)
    correlation = (here * there).sum(axis=1) / np.sqrt(energy * other_energy + 1.0)
    variance = np.maximum(energy * (1 - correlation**2) / here.shape[1], 1.0)
    slope = patches(gradients(one), points)
    information = np.einsum("npi,npj->nij", slope, slope) * SAMPLE_STEP**2 + 1e-3 * np.eye(2)
    # what differs is smooth over about half a patch, so that its pixels do not err independently
    covariance = np.linalg.inv(information) * (variance * HALF_PATCH)[:, None, None]
    return PatchMatches(moved, correlation, covariance, found)


def same_sense(vectors: Array, like: Array) -> Array:
    """Return vectors (N, 2) with their signs such that none runs against those of another array (N, 2)."""
    return np.asarray(vectors * np.where((vectors * like).sum(axis=1) < 0, -1.0, 1.0)[:, None])
