"""The measures of sharpness that others use."""

from collections.abc import Callable

import cv2
import numpy as np
from skimage.measure import blur_effect

from blur2view.arrays import AnyArray


def grey_levels(image: AnyArray) -> AnyArray:
    """Return the grey levels (H, W), uint8, of a picture (H, W, 3), float32 in [0, 1]."""
    return np.asarray(cv2.cvtColor((image * 255).round().astype(np.uint8), cv2.COLOR_RGB2GRAY))


def laplacian_variance(image: AnyArray) -> float:
    """Return the variance of the Laplacian of a picture's grey levels."""
    return float(cv2.Laplacian(grey_levels(image), cv2.CV_64F).var())


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
