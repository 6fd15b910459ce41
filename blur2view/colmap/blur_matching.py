"""Patches of two photographs, each blurred with the smear of the other one, and found in it.

Blurs commute: a scene S blurred by k and then by l is the same as S blurred by l and then by k. So ordinary
registration (pyramidal Lucas-Kanade, Bouguet 2001) finds patches to a fraction of a pixel where SIFT's
features do not match. It works in linear light: in the file's gamma residuals along the smears of RedKitchen
are twice as large.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array

GAMMA = 2.2  # of stored pixels
WHITE_QUANTILE, MAX_GAIN = 0.98, 20.0  # of the pixels of a photograph, and of its brightening
HALF_PATCH = 14  # pixels; patches of 29 px
SAMPLE_STEP = 3  # pixels between samples of a patch where two are compared
SAMPLE_PX, MAX_SAMPLES = 1.5, 24  # of a smear's length between samples of the blur, and their number
MIN_BLUR_PX = 0.5  # shorter smears are not applied
LENGTH_QUANTILE = 0.97  # of a picture's smears, to which longer ones are shortened
CONTRAST_WINDOW = 61  # pixels over which brightness and contrast are made equal
CONTRAST, MEAN_GREY, NOISE = 40.0, 128.0, 2.0  # deviation and mean after that, of 8 bits; noise before it
MAX_ROUND_TRIP_PX = 0.5  # forward-backward error of a patch that is tracked there and back
MIN_CORRELATION = 0.8  # of two patches
LOST_PX = 1e4  # motion of a patch that is not found


def linear_light(image: Any) -> Any:
    """Return a photograph, (H, W, 3) or (H, W) with white 1, as linear grey, float32, its whites 255.

    A photograph taken at night or in deep water is brightened, as far as its noise allows.
    """
    grey: Any = np.asarray(image, np.float32)
    if grey.ndim == 3:
        grey = cv2.cvtColor(np.ascontiguousarray(grey[..., :3]), cv2.COLOR_RGB2GRAY)
    light = np.maximum(grey, 0) ** np.float32(GAMMA)
    white = float(np.quantile(light[::4, ::4], WHITE_QUANTILE))
    return light * np.float32(255 * min(MAX_GAIN, 1 / max(white, TINY)))


@lru_cache(8)
def pixels_of(width: int, height: int) -> Any:
    """Return the pixels (H, W, 2) of a picture, float32, which nobody may change."""
    columns, rows = (np.arange(side, dtype=np.float32) for side in (width, height))
    return np.dstack(np.meshgrid(columns, rows))


def resampled(image: Any, pixels: Any, how: int = cv2.INTER_LINEAR) -> Any:
    """Return an image (H, W, ...) at the pixels of a map (h, w, 2), float32: (h, w, ...), mirrored beyond."""
    remap: Any = cv2.remap  # whose stubs want two maps
    values = remap(image, pixels, None, how, borderMode=cv2.BORDER_REFLECT)
    return values.reshape(*pixels.shape[:2], *image.shape[2:])


def shortened(path: Array) -> Array:
    """Return smears (N, 2) of a picture, few of them shorter: none is much longer than most."""
    length = np.hypot(path[:, 0], path[:, 1])
    longest = np.quantile(length, LENGTH_QUANTILE)
    return np.asarray(path * np.minimum(1, longest / np.maximum(length, TINY))[:, None])


def blurred_along(image: Any, path: Any, bend: Any = None, moments: bool = False) -> list[Any]:
    """Return an image (H, W, ...) blurred along path t + bend t^2, (H, W, 2), with t from -1/2 to 1/2.

    The list holds this image and, with ``moments``, those whose samples are weighted by t and t^2.
    """
    height, width = image.shape[:2]
    longest = float(np.hypot(*np.moveaxis(path[::8, ::8], -1, 0)).max())
    if longest <= MIN_BLUR_PX:
        return [image, *(np.zeros_like(image, np.float32) for _ in range(2 * moments))]
    pixels = pixels_of(width, height)
    count = int(np.clip(np.ceil(longest / SAMPLE_PX), 2, MAX_SAMPLES))
    sums = [np.zeros_like(image, np.float32) for _ in range(3 if moments else 1)]
    remap: Any = cv2.remap  # whose stubs want two maps
    shifted, sample = np.empty_like(pixels), np.empty_like(image, np.float32)
    for t in (np.arange(count, dtype=np.float32) + 0.5) / np.float32(count) - np.float32(0.5):
        cv2.scaleAdd(path, -t, pixels, shifted)
        if bend is not None:
            cv2.scaleAdd(bend, -t * t, shifted, shifted)
        remap(image, shifted, None, cv2.INTER_LINEAR, sample, cv2.BORDER_REFLECT)
        for power, total in enumerate(sums):
            cv2.scaleAdd(sample, t**power / np.float32(count), total, total)
    return sums


def equalised(image: Any) -> Any:
    """Return a float32 image with equal mean and contrast everywhere, uint8, as OpenCV's tracker reads."""
    window = (CONTRAST_WINDOW, CONTRAST_WINDOW)
    mean = cv2.blur(image, window)
    spread = np.sqrt(np.maximum(cv2.blur(image * image, window) - mean * mean, 0) + NOISE**2)
    return np.clip((image - mean) / spread * CONTRAST + MEAN_GREY, 0, 255).astype(np.uint8)


def tracked(first: Any, second: Any, points: Array, guess: Array, levels: int) -> Array:
    """Return motions (N, 2) of patches at (N, 2) between uint8 images, near a guess (N, 2), or `LOST_PX`."""
    if not len(points):
        return np.zeros((0, 2))
    start = np.array(points, np.float32).reshape(-1, 1, 2)
    end = np.array(points + guess, np.float32).reshape(-1, 1, 2)
    side = 2 * HALF_PATCH + 1
    found, good, _ = cv2.calcOpticalFlowPyrLK(
        first, second, start, end, winSize=(side, side), maxLevel=levels,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW, minEigThreshold=1e-5,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.005),
    )  # fmt: skip
    return np.where(good == 1, (found - start)[:, 0].astype(float), LOST_PX)


def patches(image: Any, points: Array) -> Any:
    """Return patches (N, M, ...) of an image about points (N, 2), less their mean, float32."""
    steps = np.arange(-HALF_PATCH, HALF_PATCH + 1, SAMPLE_STEP, dtype=np.float32)
    steps -= steps.mean()
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    values = resampled(image, np.asarray(points, np.float32)[:, None] + offsets)
    values -= values.mean(axis=1, keepdims=True)
    return values


def gradients(image: Any) -> list[Any]:
    """Return the derivatives of an image by x and y, each (H, W)."""
    return [cv2.Sobel(image, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1))]


def match_patches(
    first: Any, second: Any, points: Array, levels: int
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Find the patches of a float32 image at points (N, 2) in another that is about aligned with it.

    Returned are their motions (N, 2) in pixels, the covariances (N, 2, 2) of these, long along an edge or a
    smear, and which patches are found (N,): tracked there and back, and correlated.
    """
    first, second = equalised(first), equalised(second)
    moved = tracked(first, second, points, np.zeros_like(points), levels)
    back = tracked(second, first, points + moved, -moved, 0)
    back_again = np.linalg.norm(moved + back, axis=1) < MAX_ROUND_TRIP_PX
    moved = np.where(back_again[:, None], moved, 0.0)
    first, second = first.astype(np.float32), second.astype(np.float32)
    both, there = patches(cv2.merge([first, *gradients(first)]), points), patches(second, points + moved)
    here, slope = both[..., 0], both[..., 1:]
    energy, other_energy = (_dot(one, one) for one in (here, there))
    correlation = _dot(here, there) / np.sqrt(energy * other_energy + 1.0)
    variance = np.maximum(energy * (1 - correlation**2) / here.shape[1], 1.0)
    information = np.swapaxes(slope, 1, 2) @ slope * SAMPLE_STEP**2 + 1e-3 * np.eye(2)
    # differences are smooth over about half a patch, so that its pixels do not err independently
    covariance = np.linalg.inv(information) * (variance * HALF_PATCH)[:, None, None]
    return moved, covariance, back_again & (correlation > MIN_CORRELATION)


def _dot(one: Any, other: Any) -> Any:
    """Return the inner products (N,) of patches (N, M)."""
    return np.einsum("nm,nm->n", one, other).astype(float)


def blur_equations(blurred: Sequence[Any], other: Any, points: Array, moved: Array, flow: Array) -> Array:
    """Return normal equations (9, 10) of a motion's correction, from differences of patches at (N, 2).

    To first order a blurred picture changes by the blurred gradients, weighted by t and t^2, times the change
    of path and bend: ``blurred`` are weighted by 1, t, t^2, ``flow`` (N, 2, 6) is that of the points. Gain
    and displacement of each patch are free, and projected out.
    """
    picture, by_t, by_t2 = blurred
    there = patches(other, points + moved)[..., None]
    free = patches(cv2.merge([picture, *gradients(picture)]), points)  # (N, M, 3)
    slopes = patches(cv2.merge([*gradients(by_t), *gradients(by_t2)]), points)
    flow = flow.astype(np.float32)
    change = -np.concatenate([slopes[..., :2] @ flow, slopes[..., 2:] @ flow[:, :, :3]], axis=-1)
    contrast = free[..., 0].std(axis=1)
    free = free / (np.linalg.norm(free, axis=1, keepdims=True) + 1e-6)
    basis, _ = np.linalg.qr(free)
    across = np.swapaxes(basis, 1, 2)
    rows = np.concatenate([change, there], axis=-1)  # (N, M, 10)
    rows -= basis @ (across @ rows)
    variance = (0.1 * contrast) ** 2 + (rows[..., 9] ** 2).mean(axis=1) + 1e-6
    rows /= np.sqrt(variance * (HALF_PATCH / SAMPLE_STEP))[:, None, None]
    every = rows.reshape(-1, 10).astype(float)
    return np.asarray(every[:, :9].T @ every)
