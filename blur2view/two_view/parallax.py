"""How likely smears are under one homography, and under a homography with parallax along epipolar lines.

A displacement, order unknown, is compared with what a homography predicts. Under the homography alone its
error is as large along the epipolar line as across it; under an F some smears lie farther along the line,
by parallax. Both are mixtures of Gaussians of fixed widths, with chance, whose weights are fitted by
expectation-maximisation: a convex problem, the first nested in the second, so that twice the difference of
the log-likelihoods measures how far the smears prove parallax. Lengths and deviations are in pixels of a
Sampson distance: displacements over sqrt(2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import homogeneous
from blur2view.geometry.sampson import signed_sampson
from blur2view.robust.homography import transfer_residuals
from blur2view.robust.residuals import WeightedEnds

SCALES = (0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 4.0)  # of the standard deviations, which may be misjudged
LARGEST = 1.4  # scale at which a smear off the homography may still count as on its epipolar line
WIDTHS = (1.5, 4.0, 12.0, 40.0)  # of parallax, in standard deviations
REACHES = (0.25, 0.5, 1.0, 1.5)  # chance spreads displacements over discs of these times the longest
ROUNDS = 25  # of expectation-maximisation


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Evidence of smears for a homography and for parallax: shares of them, a gain in log-likelihood.

    ``gain`` is twice the log-likelihood with parallax minus that without; ``on_plane`` the share of smears
    that the homography alone explains, ``parallax`` the share that F explains off it.
    """

    gain: float
    on_plane: float
    parallax: float


def parallax_evidence(A: Array, F: Array, matches: WeightedEnds, unit_px: float) -> Evidence:
    """Return how the homography of generator A, alone and with parallax along the lines of F (3, 3), compare.

    Coordinates are normalised, ``unit_px`` pixels per unit. Of F and its transpose, which fit equally, the
    one is taken whose orders of the smears agree better with A's.
    """
    sigma = matches.sigma * unit_px
    measured = np.linalg.norm(matches.ends[:, 1] - matches.ends[:, 0], axis=1) * unit_px * np.sqrt(0.5)
    along, across, off_line = min(
        (_deviations(A, f, matches) * unit_px for f in (F, F.T)),
        key=lambda d: float(np.minimum(((d**2).sum(axis=0) / sigma**2).min(axis=0), 25.0).sum()),
    )
    white = (np.array(SCALES)[:, None] * sigma) ** 2  # (S, N)
    alone = _gaussian(along, across, white, white)
    on_line = _gaussian(along, off_line, white, white)
    near = white[np.array(SCALES) <= LARGEST]
    wider = near + (np.array(WIDTHS)[:, None, None] * sigma) ** 2  # (W, S, N)
    beside = _gaussian(along, off_line, wider, near).reshape(-1, len(sigma))
    chance = chance_densities(measured)
    simple = np.concatenate([alone, chance]).T
    weights, _ = mixture(simple)
    _, without = mixture(simple, weights)  # as many rounds for the one as for the other
    on_plane = float(weights[: len(alone)].sum())
    start = np.insert(weights, len(alone), np.full(len(beside), 0.3 * on_plane / len(beside)))
    start[: len(alone)] *= 0.7
    fitted, together = mixture(np.concatenate([on_line, beside, chance]).T, start)
    parallax = float(fitted[len(alone) : len(alone) + len(beside)].sum())
    return Evidence(gain=2 * float((together - without).sum()), on_plane=on_plane, parallax=parallax)


def _deviations(A: Array, F: Array, matches: WeightedEnds) -> Array:
    """Return deviations (3, 2, N): along and across F's lines from a homography, and from the lines."""
    one, other = matches.ends[:, 0], matches.ends[:, 1]
    normal = (homogeneous(matches.ends.mean(axis=1)) @ F.T)[:, :2]
    normal /= np.maximum(np.linalg.norm(normal, axis=1), TINY)[:, None]
    line = np.stack([normal[:, 1], -normal[:, 0]], axis=1)
    deviation = np.moveaxis(transfer_residuals(A, matches), 1, 2)  # (2, N, 2)
    off_line = [signed_sampson(F, one, other), signed_sampson(F, other, one)]
    return np.stack([(deviation * line).sum(-1), (deviation * normal).sum(-1), off_line])


def chance_densities(measured: Array) -> list[Array]:
    """Return densities (N,) of displacements spread evenly over discs; ``measured`` (N,) their lengths."""
    radii = np.array(REACHES) * max(float(np.quantile(measured, 0.95)), TINY)
    floor = 1e-3 / (np.pi * radii[-1] ** 2)  # a smear longer than all discs must not have no density at all
    return [np.where(measured <= radius, 1 / (np.pi * radius**2), floor) for radius in radii]


def _gaussian(along: Array, across: Array, var_along: Array, var_across: Array) -> Array:
    """Return densities (..., N) of deviations (2, N), both orders equally likely, by variances (..., N)."""
    density: Array = np.zeros(np.broadcast_shapes(var_along.shape, var_across.shape))
    for a, b in zip(along, across, strict=True):
        density += np.exp(-0.5 * (a * a / var_along + b * b / var_across))
    density *= (0.25 / np.pi) / np.sqrt(var_along * var_across)
    return density


def mixture(density: Array, start: Array | None = None) -> tuple[Array, Array]:
    """Return weights (J,) of greatest likelihood for components of density (N, J), and log-densities (N,)."""
    weights = np.full(density.shape[1], 1 / density.shape[1]) if start is None else start
    for _ in range(ROUNDS):
        weights = weights * ((1 / (density @ weights)) @ density) / len(density)
    return weights, np.log(density @ weights)
