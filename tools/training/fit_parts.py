"""Fit the decision on parts that move, `blur2view.movers.parts`, to photographs with truth and to still ones.

``python -m tools.training.fit_parts FOLDERS...`` prints the three constants, and the area under the curve of
parts that move against those that do not. A photograph with an ``.npz`` beside it has the truth of
`tools.datasets.mover_scenes`; in one without nothing moves by itself.
"""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from blur2view.arrays import Array
from blur2view.movers.inputs import PLACE_PX
from blur2view.movers.parts import described
from blur2view.movers.probability import moving_probability
from blur2view.networks.smear_network import SmearNetwork
from blur2view.photographs.image import read_image
from blur2view.pipeline import estimate
from tools.arguments import Existing, run
from tools.metrics import auc

MOVES, STANDS = 0.5, 0.1
"""Shares of a part, from which on it moves, and below which it does not; others are left out."""
RIDGE = 1e-3


def parts_in(path: Path, network: SmearNetwork) -> tuple[Array, Array]:
    """Return the features (N, 2) of the parts of a photograph, and the shares (N,) of each that move."""
    image = read_image(path)
    found = estimate(image, network=network)
    rng = np.random.default_rng(0) if found.blur.kind.of_camera else None
    moving = moving_probability(image, found.grid, found.geometry.F, rng=rng)
    part, features = described(moving.moving, moving.departure)
    moves = np.zeros(part.shape, np.float32)
    if (truth := path.with_suffix(".npz")).exists():
        with np.load(truth) as stored:
            static, valid = stored["static"], stored["valid"]
        rows, columns = (min(a, b) for a, b in zip(part.shape, static.shape, strict=True))
        moves[:rows, :columns] = (~static & valid)[:rows, :columns]
    area = np.bincount(part.ravel(), minlength=len(features) + 1)[1:]
    return features, np.bincount(part.ravel(), moves.ravel(), len(features) + 1)[1:] / np.maximum(area, 1)


def fitted(features: Array, moves: NDArray[np.bool_]) -> Array:
    """Return constant and weights of a logistic regression in which both answers count the same."""
    inputs = np.c_[np.ones(len(features)), features]
    weight = np.where(moves, 1 / moves.sum(), 1 / (~moves).sum())

    def loss(coefficients: Array) -> float:
        margin = np.where(moves, 1, -1) * (inputs @ coefficients)
        return float((weight * np.logaddexp(0, -margin)).sum() + RIDGE * (coefficients[1:] ** 2).sum())

    return np.asarray(minimize(loss, np.zeros(inputs.shape[1])).x)


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
    found = [parts_in(path, network) for path in names]
    features, share = (np.concatenate(each) for each in zip(*found, strict=True))
    known = (share > MOVES) | (share < STANDS)
    features, moves = features[known], share[known] > MOVES
    coefficients = fitted(features, moves)
    score = features @ coefficients[1:]
    print(f"{moves.sum()} parts that move and {(~moves).sum()} that do not, of {len(names)} photographs")
    print("CONSTANT, PEAK, DEPARTURE =", ", ".join(f"{value:.2f}" for value in coefficients))
    print(f"area under the curve {auc(score[~moves], score[moves]):.3f}; places of {PLACE_PX} px")


if __name__ == "__main__":
    run(main)
