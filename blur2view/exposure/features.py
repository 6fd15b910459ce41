"""Matched pixels of neighbouring photographs, by OpenCV's SIFT."""

from contextlib import suppress

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array

Features = tuple[Array, NDArray[np.float32]]  # points (N, 2), descriptors (N, 128)
MAX_SIDE = 640  # pictures are matched at no more pixels: blurred ones show no more in more
MAX_FEATURES = 4000  # with 1000 the rotation of 94 % of RedKitchen's frames came out right instead of 100 %
CONTRAST_THRESHOLD = 0.01  # SIFT's: blurred pictures have little
RATIO = 0.8  # best over second best distance (Lowe 2004)
MAX_ERROR_PX = 2.0  # of the epipolar geometry that verifies them
MIN_MATCHES = 12  # verified matches; fewer may be chance
NO_POINTS = np.zeros((0, 2))
NO_FEATURES: Features = (NO_POINTS, np.zeros((0, 128), np.float32))


def features_of(image: NDArray[np.float32]) -> Features:
    """Return SIFT features of a photograph (H, W, 3), RGB in [0, 1]: its pixels (N, 2), and descriptors."""
    grey = np.asarray(np.rint(255 * cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)), np.uint8)
    scale = min(1.0, MAX_SIDE / max(grey.shape))
    if scale < 1:
        grey = np.asarray(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
    # without the last option OpenCV's features lie a quarter of a pixel off
    sift = cv2.SIFT.create(MAX_FEATURES, contrastThreshold=CONTRAST_THRESHOLD, enable_precise_upscale=True)
    keypoints, descriptors = sift.detectAndCompute(grey, None)
    if not keypoints:
        return NO_FEATURES
    points = (np.array([keypoint.pt for keypoint in keypoints]) + 0.5) / scale - 0.5
    return points, np.asarray(descriptors, np.float32)


def match_features(one: Features, other: Features) -> tuple[Array, Array]:
    """Return the matches (M, 2) of mutual nearest neighbours by the ratio test, on one epipolar geometry."""
    if min(len(one[0]), len(other[0])) < MIN_MATCHES:
        return NO_POINTS, NO_POINTS
    unit1, unit2 = (d / np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-6) for _, d in (one, other))
    similarity = unit1 @ unit2.T
    best, back = similarity.argmax(axis=1), similarity.argmax(axis=0)
    rows = np.arange(len(best))
    near = np.sqrt(np.maximum(2 - 2 * similarity[rows, best], 0))
    similarity[rows, best] = -np.inf
    second = np.sqrt(np.maximum(2 - 2 * similarity.max(axis=1), 0))
    chosen = np.flatnonzero((near < RATIO * second) & (back[best] == rows))
    points1, points2, kept = one[0][chosen], other[0][best[chosen]], np.zeros(0, bool)
    if len(chosen) >= MIN_MATCHES:
        bound = MAX_ERROR_PX * max(1.0, float(max(points1.max(), points2.max())) / MAX_SIDE)
        with suppress(cv2.error):  # of a few places over and over, as noise may match (usac/estimator.cpp)
            inliers = cv2.findFundamentalMat(points1, points2, cv2.USAC_MAGSAC, bound, 0.999, 2000)[1]
            kept = np.zeros(0, bool) if inliers is None else inliers.ravel().astype(bool)
    return (points1[kept], points2[kept]) if kept.sum() >= MIN_MATCHES else (NO_POINTS, NO_POINTS)
