"""What has one colour and lies nearby moves alike: log-odds of places are averaged over such places.

A bilateral filter as wide as objects are: of all places within an eighth of the picture those of a like
colour have a say. Places are gathered in bins of colour and position, all of which are weighed against each
other.

References
----------
Chen, Paris, Durand, Real-time edge-aware image processing with the bilateral grid, SIGGRAPH 2007.
Kraehenbuehl, Koltun, Efficient inference in fully connected CRFs with Gaussian edge potentials, NIPS 2011.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

LUMA, COLOUR, REACH = 0.07, 0.04, 0.13
"""Standard deviations of the weights: luma, differences of colours, and position as a share of the width."""
BIN = 1.5
"""Side of a bin, standard deviations."""
EDGE_PLACES, EDGE_EPS = 3, 1e-2
"""Radius of the windows in which averages follow the picture's edges, places; OpenCV's epsilon."""
ROWS = 1000
"""Bins that are weighed at a time, which bounds the memory."""


def bilateral_mean(values: Floats, colour: Floats, known: NDArray[np.bool_]) -> Floats:
    """Return the mean (h, w) of the values (h, w) that are known, over places nearby of a like colour.

    Parameters
    ----------
    values : ndarray of shape (h, w)
    colour : ndarray of shape (h, w, 3)
        Luma and two differences of colours, levels in [0, 1], as of `blur_evidence.Picture`.
    known : ndarray of shape (h, w), bool
        Places whose values have a say.
    """
    y, x = np.mgrid[: values.shape[0], : values.shape[1]] / (REACH * values.shape[1])
    places = np.dstack([colour / np.array([LUMA, COLOUR, COLOUR]), x, y]).reshape(-1, 5)
    bins = np.round(places / BIN).astype(np.int64)
    bins -= bins.min(axis=0)
    numbers = np.ravel_multi_index(tuple(bins.T), tuple(bins.max(axis=0) + 1))
    _, index = np.unique(numbers, return_inverse=True)

    def total(weights: NDArray[np.generic]) -> Floats:
        return np.bincount(index, weights.ravel()).astype(np.float32)

    count, among = np.bincount(index).astype(np.float32), total(known)
    sums = total(np.where(known, values, 0))
    means = np.stack([total(column) for column in places.T], axis=1) / count[:, None]
    half = (means**2).sum(axis=1) / 2
    average = np.empty_like(sums)
    for first in range(0, len(means), ROWS):
        some = slice(first, first + ROWS)
        weights = np.exp(np.minimum(means[some] @ means.T - half[some, None] - half, 0))
        average[some] = (weights @ sums) / np.maximum(weights @ among, 1e-3)
    binned = np.ascontiguousarray(average[index].reshape(values.shape))
    return np.asarray(cv2.ximgproc.guidedFilter(colour, binned, EDGE_PLACES, EDGE_EPS), np.float32)
