"""The picture of a motion mask: pink on what moves, hatched where motion is unobservable."""

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from blur2view.movers.mask import MotionLabel, MotionMask
from blur2view.results.drawing import FAINT, Picture, View, captioned

PINK = (255, 70, 170)
COVER = 0.55  # share of the pink over what moves: the object stays visible
HATCH_PX = 12
LEAST_SHARE = 0.005  # of the photograph that is worth a word: less is 0 %


def draw_motion(image: AnyArray, mask: MotionMask) -> Picture:
    """Return the picture of a motion mask over its photograph (H, W, 3), as uint8 RGB.

    What moves is pink with a white rim; where motion is unobservable the photograph is dark and hatched. A
    caption below says how much moves, what the colours mean and what was measured. The photograph's longer
    side becomes 640 to 1280 pixels.
    """
    if mask.labels.shape != image.shape[:2]:
        raise ValueError(f"expected a mask of shape {image.shape[:2]}, got {mask.labels.shape}")
    view = View.of(image.shape)
    canvas = view.picture(image)
    labels = cv2.resize(mask.labels, (view.width, view.height), interpolation=cv2.INTER_NEAREST)
    moving, unseen = labels == MotionLabel.MOVING, labels == MotionLabel.UNOBSERVABLE
    canvas[unseen] = (0.45 * canvas[unseen]).astype(np.uint8)
    rows, columns = np.indices(labels.shape)
    canvas[unseen & ((rows + columns) % HATCH_PX == 0)] = FAINT
    canvas[moving] = ((1 - COVER) * canvas[moving] + COVER * np.array(PINK)).astype(np.uint8)
    rims, _ = cv2.findContours(moving.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(canvas, rims, -1, (255, 255, 255), 1, cv2.LINE_AA)
    drawn = ["pink moves"] * bool(rims) + ["hatched is unobservable"] * bool(unseen.any())
    words = "; ".join([*filter(None, [", ".join(drawn)]), mask.reason.partition(";")[0]])
    return captioned(canvas, mask_verdict(mask), words)


def mask_verdict(mask: MotionMask) -> str:
    """Return how much moves and how much is unobservable; if that is most, it comes first."""
    moving, unseen = (
        float((mask.labels == k).mean()) for k in (MotionLabel.MOVING, MotionLabel.UNOBSERVABLE)
    )
    if unseen == 1:
        return "motion is unobservable everywhere"
    count = len(mask.regions)
    share = f"{moving:.1%}" if moving >= 0.001 else "under 0.1%"
    parts = f"{count} moving part{'s' if count > 1 else ''}, {share} of the photograph"
    moves = parts if count else "no mover found"
    if unseen < LEAST_SHARE:
        return moves
    hidden = f"motion is unobservable in {min(round(100 * unseen), 99)}%"  # all is another line
    return f"{moves}; {hidden}" if unseen <= 0.5 else f"{hidden}; elsewhere {moves}"
