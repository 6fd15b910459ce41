"""The camera's own motion over the whole picture: one smooth field through the cells, robust to movers.

Displacements are a quadratic polynomial of the place, as instantaneous rotations and planes give them. The
sign of every smear is the one nearer to the field. Affine fields through three cells each, in every choice
of signs, are starts; the one with the least Geman-McClure cost is refined by reweighted least squares.
"""

from __future__ import annotations

import numpy as np

from blur2view.arrays import Array
from blur2view.movers.evidence import Cells
from blur2view.smears.grid import SmearGrid

SAMPLES, SCORED = 150, 400  # triples of cells, and cells that their fields are scored on
SIGNS = np.array([[1, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]], float)
STEPS = 12  # of reweighted least squares
RIDGE = 0.3  # weight, in cells, of each quadratic coefficient over FIELD_SHARE of the median length
FIELD_SHARE = 0.3


def camera_field(grid: SmearGrid, weight: Array, rng: np.random.Generator) -> Array:
    """Return the displacement (h, w, 2) that the camera's motion gives every cell of a grid, pixels.

    ``weight`` (h, w), 0 to 1, is little where something else is known to move; ``rng`` draws the starts.
    """
    cells, size = Cells.of(grid), np.array(grid.shape[::-1])
    seen, counted = cells.displacement.reshape(-1, 2), weight.ravel()
    x, y = (grid.points().reshape(-1, 2) - (size - 1) / 2).T / (max(size) / 2)
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    sigma, model = cells.error_px.ravel(), np.zeros((6, 2))
    model[:3] = _start(basis[:, :3], seen, sigma, counted, rng)
    length = FIELD_SHARE * max(float(np.median(np.linalg.norm(seen, axis=1))), 1.0)
    ridge = np.diag(np.array([0, 0, 0, 1, 1, 1]) * RIDGE / length**2 + 1e-9)
    for _ in range(STEPS):
        predicted = basis @ model
        signed = np.where((predicted * seen).sum(axis=1, keepdims=True) < 0, -seen, seen)
        squared = ((signed - predicted) ** 2).sum(axis=1) / (4 * sigma**2)
        weighed = basis * (counted / (1 + squared) ** 2 / sigma**2)[:, None]
        model = np.linalg.solve(weighed.T @ basis + ridge, weighed.T @ signed)
    return np.asarray((basis @ model).reshape(cells.displacement.shape))


def _start(basis: Array, seen: Array, sigma: Array, weight: Array, rng: np.random.Generator) -> Array:
    """Return the affine field (3, 2) of least cost through three cells each, or constant as one."""
    share = weight / sigma
    share = share / share.sum() if share.sum() > 0 else np.full(len(seen), 1 / len(seen))
    triples = rng.choice(len(seen), (SAMPLES, 3), p=share)
    inverse = np.linalg.pinv(basis[triples], rcond=1e-3)  # (S, 3, 3)
    signed = seen[triples][:, None] * SIGNS[None, :, :, None]  # (S, 4, 3, 2)
    constant = np.zeros((SAMPLES, 3, 2))
    constant[:, 0] = seen[triples[:, 0]]
    models = np.concatenate([(inverse[:, None] @ signed).reshape(-1, 3, 2), constant])
    scored = rng.permutation(len(seen))[:SCORED]
    x, y = (models[..., k] @ basis[scored].T for k in (0, 1))  # (M, SCORED)
    seen_x, seen_y = seen[scored].T
    squared = x * x + y * y + (seen_x**2 + seen_y**2) - 2 * np.abs(x * seen_x + y * seen_y)
    error = squared / (4 * sigma[scored] ** 2)
    cost = (weight[scored] / sigma[scored] * error / (1 + error)).sum(axis=1)
    return np.asarray(models[np.argmin(cost)])
