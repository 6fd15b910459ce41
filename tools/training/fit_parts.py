"""Fit what `blur2view.movers` makes of a network's log-odds to photographs with truth, and to still ones.

``python -m tools.training.fit_parts FOLDERS...`` prints the constants from log-odds to probabilities of
places (`blur2view.movers.probability`) and of parts (`blur2view.movers.parts`), and the area under the curve
of parts that move against those that do not. A photograph with an ``.npz`` beside it has the truth of
`tools.datasets.mover_scenes`; in one without nothing moves by itself, and only its parts count.
"""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from blur2view.arrays import Array
from blur2view.images.image import read_image
from blur2view.movers.parts import described
from blur2view.movers.probability import SCALE, SHIFT, moving_probability
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import estimate
from tools.arguments import Existing, run
from tools.metrics import auc

MOVES, STANDS = 0.5, 0.1
"""Shares of a part, from which on it moves, and below which it does not; others are left out."""
EVERY = 11
"""Of neighbouring places, which are alike, one in so many counts."""


def read(path: Path, network: SmearNetwork) -> tuple[Array, Array]:
    """Return the highest log-odds and the moving share (N, 2) of a photograph's parts.

    Then, where that is known, the log-odds of places and whether they move (M, 2).
    """
    image = read_image(path)
    found = estimate(image, network=network)
    rng = np.random.default_rng(0) if found.blur.kind.of_camera else None
    seen = moving_probability(image, found.grid, found.geometry.F, found.camera, rng)
    part, highest = described(seen.odds, ~seen.smooth)
    moves, known = np.zeros(part.shape, np.float32), np.zeros(part.shape, bool)
    if (truth := path.with_suffix(".npz")).exists():
        with np.load(truth) as stored:
            static, valid = stored["static"], stored["valid"]
        place = tuple(slice(min(sides)) for sides in zip(part.shape, static.shape, strict=True))
        moves[place], known[place] = (~static & valid)[place], valid[place]
    known &= ~seen.smooth
    share = np.bincount(part.ravel(), moves.ravel(), len(highest) + 1) / np.bincount(part.ravel())
    places = np.stack([seen.odds[known], moves[known]], axis=1)[::EVERY].astype(float)
    return np.stack([highest, share[1:]], axis=1), places


def fitted(odds: Array, moves: NDArray[np.bool_], weight: Array) -> Array:
    """Return constant and slope of a weighted logistic regression."""

    def loss(coefficients: Array) -> float:
        margin = np.where(moves, 1, -1) * (coefficients[0] + coefficients[1] * odds)
        return float((weight * np.logaddexp(0, -margin)).sum() / weight.sum())

    return np.asarray(minimize(loss, np.array([SHIFT, SCALE])).x)


def main(folders: list[Existing]) -> None:
    """Print the constants."""
    cv2.setNumThreads(1)
    network = SmearNetwork()
    names = [
        path
        for folder in folders
        for path in sorted(folder.iterdir())
        if path.suffix in (".png", ".jpg") and not path.stem.endswith(("_open", "_close", ".truth"))
    ]
    found = zip(*(read(path, network) for path in names), strict=True)
    (highest, share), (odds, moves) = (np.concatenate(each).T for each in found)
    print("SHIFT, SCALE =", fitted(odds, moves > MOVES, np.ones(len(odds))).round(2))
    certain = (share > MOVES) | (share < STANDS)
    highest, part = highest[certain], share[certain] > MOVES
    print(f"{part.sum()} parts that move and {(~part).sum()} that do not, of {len(names)} photographs")
    alike = np.where(part, 1 / part.sum(), 1 / (~part).sum())
    print("CONSTANT, PEAK =", fitted(highest, part, alike).round(2))
    print(f"area under the curve {auc(highest[~part], highest[part]):.3f}")


if __name__ == "__main__":
    run(main)
