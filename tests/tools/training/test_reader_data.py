"""Which cells show their blur: texture does, noise and even areas do not, nor what is finer than the blur."""

import cv2
import numpy as np
from numpy.typing import NDArray

from tools.training.reader_data import shows_blur


def texture(sigma: float) -> NDArray[np.float32]:
    noise = np.random.default_rng(0).standard_normal((256, 320)).astype(np.float32)
    return np.float32(0.5) + 0.1 * cv2.GaussianBlur(noise, (0, 0), sigma) * sigma


def test_texture_shows_and_what_is_even_or_noise_does_not() -> None:
    picture = texture(0.8)
    picture[:, :160] = 0.5
    noise = np.random.default_rng(1).normal(0, 0.02, picture.shape).astype(np.float32)
    shows = shows_blur(picture + noise, 0.5 + noise, np.full((8, 10), 2.0))
    assert shows[:, 7:].all() and not shows[:, :3].any()
