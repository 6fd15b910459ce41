"""Optical flow between both ends of an exposure: smears, their validity, the frames in between.

A flow (H, W, 2) gives, at every pixel of one frame, how far its point moves to the other frame, pixels.
Points move straight and evenly between the two, as in the paper.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray
from tools.rendering.exposure import pixel_grid

CROSS_CHECK_PX = 1.0
"""The paper's eps: forward and backward flow of a valid smear cancel to within this."""
SOLVED_PX = 0.25
STEPS = 12
FEWEST, MOST = 15, 240
"""Sub-frames of one exposure: the paper's least, and a bound for smears that the whole image is long."""
HIDDEN_WEIGHT = 0.05
"""Weight of a frame in which a point fails the cross-check: it counts where the other frame fails, too."""


@dataclass(frozen=True, kw_only=True)
class MidSmears:
    """Smears at mid-exposure pixels: displacement (H, W, 2) first to last, and the cross-check map (H, W)."""

    displacement: AnyArray
    valid: NDArray[np.bool_]


def sampled(field: AnyArray, positions: AnyArray) -> AnyArray:
    """Return a field (H, W) or (H, W, C) interpolated at positions (H, W, 2), its border repeated."""
    at = positions.astype(np.float32)
    mapped = cv2.remap(field, at[..., 0], at[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
    return np.asarray(mapped)


def sources(flow: AnyArray, share: float, start: AnyArray | None = None) -> tuple[AnyArray, AnyArray]:
    """Return where the points come from that are at each pixel after `share` of their way.

    Parameters
    ----------
    flow : ndarray of shape (H, W, 2)
        float32, pixels.
    share : float
        In [0, 1].
    start : ndarray of shape (H, W, 2), optional
        A first guess.

    Returns
    -------
    positions : ndarray of shape (H, W, 2)
        x with x + share flow(x) = pixel, by fixed-point iteration.
    miss : ndarray of shape (H, W)
        Pixels by which that fails: large where no point of this frame arrives.
    """
    pixels = pixel_grid((flow.shape[1], flow.shape[0]))
    x = pixels if start is None else start
    for _ in range(STEPS):
        x = pixels - np.float32(share) * sampled(flow, x)
    miss = np.linalg.norm(x + np.float32(share) * sampled(flow, x) - pixels, axis=-1)
    return x, np.asarray(miss)


def disagreement(forward: AnyArray, backward: AnyArray, at: AnyArray) -> AnyArray:
    """Return |forward + backward| (H, W) along the way there and back, for points at positions (H, W, 2)."""
    there = sampled(forward, at)
    back = sampled(backward, at + there)
    return np.asarray(np.linalg.norm(there + back, axis=-1))


def inside(points: AnyArray) -> NDArray[np.bool_]:
    """Whether points (H, W, 2) lie in a picture of this size."""
    size = np.array(points.shape[1::-1])
    return np.asarray(((points >= 0) & (points <= size - 1)).all(axis=-1))


def mid_smears(forward: AnyArray, backward: AnyArray) -> MidSmears:
    """Return the smears at mid-exposure pixels that follow from flows between the first and the last frame.

    A smear is valid if a point of the first frame is half-way there, forward and backward flow cancel
    (CROSS_CHECK_PX) and both of its ends are inside the picture. Elsewhere the displacement is a guess.
    """
    start, miss = sources(forward, 0.5)
    displacement = sampled(forward, start)
    other, other_miss = sources(backward, 0.5)
    guess = miss > np.maximum(other_miss, SOLVED_PX)
    displacement[guess] = -sampled(backward, other)[guess]
    seen = (miss < SOLVED_PX) & (disagreement(forward, backward, start) < CROSS_CHECK_PX)
    valid = seen & inside(start) & inside(start + displacement)
    return MidSmears(displacement=displacement, valid=valid)


def sub_frames(forward: AnyArray, valid: NDArray[np.bool_] | None = None) -> int:
    """Return the number of frames to average: max(2 s_max, 15), 2 s the largest displacement, up to MOST."""
    length = np.linalg.norm(forward, axis=-1)
    longest = float(length[valid].max()) if valid is not None and valid.any() else float(length.max())
    return int(np.clip(np.ceil(longest), FEWEST, MOST))


def frames_between(
    first: AnyArray, last: AnyArray, forward: AnyArray, backward: AnyArray, count: int
) -> Iterator[AnyArray]:
    """Yield linear frames (H, W, 3) at the centres of `count` equal parts of the time between two frames.

    Every frame blends what both frames say of it, weighted by how near in time they are and by the
    cross-check.
    """
    from_first: AnyArray | None = None
    from_last: AnyArray | None = None
    for k in range(count):
        tau = (k + 0.5) / count
        from_first, miss_first = sources(forward, tau, from_first)
        from_last, miss_last = sources(backward, 1 - tau, from_last)
        weights = (
            (1 - tau) * trust(miss_first, disagreement(forward, backward, from_first)),
            tau * trust(miss_last, disagreement(backward, forward, from_last)),
        )
        share = (weights[0] / (weights[0] + weights[1]))[..., None].astype(np.float32)
        yield share * sampled(first, from_first) + (1 - share) * sampled(last, from_last)


def trust(miss: AnyArray, gap: AnyArray) -> AnyArray:
    """Return weights (H, W) of one frame: small where no point arrives or the cross-check fails."""
    agreed = np.where(gap < CROSS_CHECK_PX, 1.0, HIDDEN_WEIGHT)
    return np.asarray(agreed / (1 + (miss / SOLVED_PX) ** 4) + 1e-6)


def averaged(first: AnyArray, last: AnyArray, forward: AnyArray, backward: AnyArray, count: int) -> AnyArray:
    """Return the average of the frames between two linear frames (H, W, 3), in linear light: float32."""
    total = np.zeros_like(first, dtype=np.float32)
    for frame in frames_between(first, last, forward, backward, count):
        total += frame
    return total / np.float32(count)


def computed_flow(first: AnyArray, last: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return flow from one uint8 RGB frame to another and back: OpenCV's DIS, refined forward-backward.

    Where both directions agree, each is replaced by the mean of what both say.

    References
    ----------
    Kroeger et al., Fast optical flow using dense inverse search, ECCV 2016.
    """
    grey = [cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in (first, last)]
    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    dis.setFinestScale(0)
    zero = np.zeros((*grey[0].shape, 2), np.float32)
    forward = np.asarray(dis.calc(grey[0], grey[1], zero.copy()), np.float32)
    backward = np.asarray(dis.calc(grey[1], grey[0], zero), np.float32)
    return merged(forward, backward), merged(backward, forward)


def merged(flow: AnyArray, back: AnyArray) -> AnyArray:
    """Return the average of a flow and the reverse of the flow back, where the two agree."""
    pixels = pixel_grid((flow.shape[1], flow.shape[0]))
    reverse = -sampled(back, pixels + flow)
    agreed = np.linalg.norm(flow - reverse, axis=-1, keepdims=True) < CROSS_CHECK_PX
    return np.where(agreed, (flow + reverse) / 2, flow).astype(np.float32)
