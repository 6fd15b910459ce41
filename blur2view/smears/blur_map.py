"""The blur map: which pixels of a photograph are sharp, out of focus or smeared."""

from enum import IntEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.smears.grid import SmearGrid, upsample_grid
from blur2view.smears.likelihood import BOTH, CANNOT_TELL, OUT_OF_FOCUS, SHARP, SMEARED


class BlurLabel(IntEnum):
    """Label of a pixel of a blur map; its value is the grey of ``*.blur.png``."""

    SMOOTH = 0  # the picture shows no texture, so that its blur is unknown
    SMEARED = 85  # by a motion, in focus or not
    SOFT = 170  # out of focus
    SHARP = 255


def blur_map(grid: SmearGrid) -> NDArray[np.uint8]:
    """Return the blur label of every pixel of a photograph.

    Parameters
    ----------
    grid : SmearGrid
        Its smears and kinds of blur: ``estimate.grid``.

    Returns
    -------
    ndarray of shape (H, W), uint8
        The likeliest `BlurLabel`, by the probabilities of the cells, interpolated. What is smeared has a
        smear longer than its deviation: the bokeh of leaves looks smeared as well, but in no direction. A
        cell is read from a window of 96 pixels, so that outlines are true to some 30 pixels.

    Raises
    ------
    ValueError
        If the grid has no kinds of blur, because another network read it.

    Examples
    --------
    >>> import blur2view
    >>> labels = blur2view.blur_map(blur2view.estimate("models/sample.jpg").grid)
    >>> labels.shape
    (540, 960)
    >>> bool((labels == blur2view.BlurLabel.SMEARED).mean() > 0.5)
    True
    """
    if grid.kinds is None:
        raise ValueError("expected smears with kinds of blur, as SmearNetwork reads them off a photograph")
    kinds, sure = grid.kinds, is_sure(grid)
    label_share = {
        BlurLabel.SMOOTH: kinds[..., CANNOT_TELL],
        BlurLabel.SMEARED: (kinds[..., SMEARED] + kinds[..., BOTH]) * sure,
        BlurLabel.SOFT: kinds[..., OUT_OF_FOCUS] + kinds[..., BOTH] * ~sure,
        BlurLabel.SHARP: kinds[..., SHARP],
    }
    shares = np.stack(list(label_share.values()), axis=-1)
    height, width = grid.shape
    index = upsample_grid(shares.astype(np.float32), grid.stride)[:height, :width].argmax(-1)
    return np.asarray(np.array(list(label_share), np.uint8)[index])


def is_sure(grid: SmearGrid) -> NDArray[np.bool_]:
    """Return whether the smear of a cell is longer than its standard deviation, (h, w)."""
    return np.asarray(grid.smears().length_px > grid.sigma_px)


def label_shares(labels: NDArray[np.uint8]) -> dict[str, float]:
    """Return the share of the pixels of each label, by its name in small letters."""
    counts = cv2.calcHist([labels], [0], None, [256], [0, 256]).ravel()
    return {label.name.lower(): float(counts[label] / labels.size) for label in reversed(BlurLabel)}
