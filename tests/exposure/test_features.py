"""Matches between photographs: a picture shifted by a known amount."""

import cv2
import numpy as np

from blur2view.exposure.features import Features, features_of, match_features

SHIFT = np.array([12.0, -5.0])


def texture(size: tuple[int, int], seed: int = 0) -> np.ndarray:
    """Give spots of all sizes, (H, W) uint8."""
    rng = np.random.default_rng(seed)
    layers = [cv2.GaussianBlur(rng.normal(size=size[::-1]), (0, 0), s) * s for s in (1.5, 3, 6, 12)]
    noise = np.sum(layers, axis=0)
    return np.asarray(255 * (noise - noise.min()) / np.ptp(noise), np.uint8)


def detect(grey: np.ndarray) -> Features:
    """Return the features of a grey picture (H, W) uint8."""
    return features_of(np.repeat(grey[..., None] / np.float32(255), 3, axis=2))


def test_matches_of_a_shifted_picture_are_its_shift() -> None:
    picture, shift = texture((320, 240)), np.column_stack([np.eye(2), SHIFT])
    moved = cv2.warpAffine(picture, shift, (320, 240), borderMode=cv2.BORDER_REFLECT)
    points1, points2 = match_features(detect(picture), detect(np.asarray(moved)))
    assert len(points1) > 50
    np.testing.assert_allclose(np.median(points2 - points1, axis=0), SHIFT, atol=0.1)
    assert (np.linalg.norm(points2 - points1 - SHIFT, axis=1) < 2).mean() > 0.95


def test_blank_and_unrelated_pictures_have_no_matches() -> None:
    blank = detect(np.full((240, 320), 90, np.uint8))
    one, other = (detect(texture((320, 240), seed)) for seed in (0, 1))
    assert blank[0].shape == (0, 2) and blank[1].shape == (0, 128)  # SIFT's
    for pair in ((blank, one), (one, blank), (one, other)):
        points1, points2 = match_features(*pair)
        assert points1.shape == points2.shape == (0, 2)
