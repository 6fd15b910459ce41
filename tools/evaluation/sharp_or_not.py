"""Sharp or not: the measures of sharpness that others use, and how well a measure tells the two apart."""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import ArrayLike
from skimage.measure import blur_effect

from blur2view.arrays import AnyArray
from tools.benchmarks.triage import laplacian_variance


def grey_levels(image: AnyArray) -> AnyArray:
    """Return the grey levels (H, W), uint8, of a picture (H, W, 3), float32 in [0, 1]."""
    return np.asarray(cv2.cvtColor((image * 255).round().astype(np.uint8), cv2.COLOR_RGB2GRAY))


def tenengrad(image: AnyArray) -> float:
    """Return the mean squared gradient (Sobel, 3x3) of a picture's grey levels.

    References
    ----------
    Krotkov, Focusing, International Journal of Computer Vision 1, 1988.
    """
    grey = grey_levels(image)
    return float(sum((cv2.Sobel(grey, cv2.CV_64F, x, 1 - x) ** 2).mean() for x in (0, 1)))


BASELINES: dict[str, Callable[[AnyArray], float]] = {
    "variance of the Laplacian": lambda image: -laplacian_variance(image),
    "Tenengrad": lambda image: -tenengrad(image),
    "`blur_effect` of scikit-image": lambda image: float(blur_effect(grey_levels(image))),
}
"""Measures of the blur of a picture (H, W, 3), float32 in [0, 1]: the larger, the less sharp."""


def auc(sharp: ArrayLike, blurred: ArrayLike) -> float:
    """Return the area under the ROC curve: how often a blurred picture has the larger value; ties count half.

    ValueError without a value of each.
    """
    low, high = _sorted(sharp, blurred)
    below = [np.searchsorted(low, high, side).mean() / len(low) for side in ("left", "right")]
    return float(np.mean(below))


def best_accuracy(sharp: ArrayLike, blurred: ArrayLike) -> tuple[float, float]:
    """Return the accuracy of the best threshold, and of another the mean of the shares right of both classes.

    The second does not gain by calling all pictures what most are. ValueError without a value of each.
    """
    low, high = _sorted(sharp, blurred)
    bounds = np.concatenate([low, high, [np.inf]])  # from which on a picture is called blurred
    kept = np.searchsorted(low, bounds)
    found = len(high) - np.searchsorted(high, bounds)
    accuracy = (kept + found) / (len(low) + len(high))
    return float(accuracy.max()), float((kept / len(low) + found / len(high)).max() / 2)


def _sorted(sharp: ArrayLike, blurred: ArrayLike) -> tuple[AnyArray, AnyArray]:
    low, high = (np.sort(np.asarray(values, float).ravel()) for values in (sharp, blurred))
    if not len(low) or not len(high):
        raise ValueError(f"expected values of both classes, got {len(low)} and {len(high)}")
    return low, high
