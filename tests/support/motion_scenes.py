"""Photographs of a camera that moves, or stands, and of a box that moves by itself before it."""

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage import data

HEIGHT, WIDTH = 480, 640
BOX = slice(160, 320), slice(352, 544)
SIDEWAYS, MOVER = (12.0, 0.0), (3.0, 24.0)

Floats = NDArray[np.float32]


def smears(camera: tuple[float, float], box: tuple[slice, slice] | None = BOX) -> Floats:
    """Smears (H, W, 2) of a camera, and of a box before it, pixels."""
    displacement = np.full((HEIGHT, WIDTH, 2), camera, np.float32)
    if box is not None:
        displacement[box] = MOVER
    return displacement


def photo(displacement: Floats) -> Floats:
    """Give a photograph (H, W, 3) that is blurred along smears (H, W, 2); what moves shows another one."""
    image = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    for smear in {tuple(one) for one in np.unique(displacement.reshape(-1, 2), axis=0).tolist()}:
        picture = data.astronaut() if smear == MOVER else data.coffee()
        sharp = cv2.resize(picture, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.float32) / 255
        size = 2 * int(max(map(abs, smear))) + 3
        kernel, middle = np.zeros((size, size), np.float32), (size - 1) / 2
        ends = [np.round(16 * (middle + sign * np.array(smear) / 2)).astype(int).tolist() for sign in (-1, 1)]
        cv2.line(kernel, ends[0], ends[1], 1.0, 1, cv2.LINE_AA, 4)
        blurred = cv2.filter2D(sharp, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT)
        here = (displacement == smear).all(axis=-1)
        image[here] = blurred[here]
    return np.asarray(np.clip(image, 0, 1), np.float32)
