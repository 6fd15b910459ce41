"""The paper's six losses, in torch: three ways to compare smears without a sign, with and without the map.

A network gives a vector v and w at every pixel; sigma = softplus(w). The loss is
``m L_R + ReLU((1 - m) / sigma^2 - alpha)``, m the cross-check map (without the map m = 1: ``L_R`` alone). L_R
is the negative log likelihood of an isotropic normal error of deviation sigma between v and the true smear d:

- ``local``: the error is the smaller of v - d and v + d, anew in every pixel;
- ``restricted``: v is compared with d turned to the right (u > 0, as Gong et al., CVPR 2017);
- ``double``: v is compared with d in double angle, |d| (cos 2 phi, sin 2 phi).

References
----------
Tran, Forssen and Viksten, Robust Fundamental Matrix Estimation from Single Image Motion Blur,
arXiv 2605.01552.
"""

from typing import Literal

import torch
from torch import Tensor
from torch.nn import functional as nnf

from blur2view.smears.field import Floats, from_double_angle

Representation = Literal["local", "restricted", "double"]

LEAST_SIGMA_PX = 0.05  # added to softplus(w), so that the likelihood is bounded


def sigma_of(raw: Tensor) -> Tensor:
    """Return sigma (N, 1, h, w), px, of raw output (N, 3, h, w)."""
    return nnf.softplus(raw[:, 2:3]) + LEAST_SIGMA_PX


def rightward(d: Tensor) -> Tensor:
    """Return smears (N, 2, h, w) pointing to the right, upright ones downward."""
    x, y = d[:, :1], d[:, 1:]
    return torch.where((x < 0) | ((x == 0) & (y < 0)), -d, d)


def double_angle(d: Tensor) -> Tensor:
    """Return |d| (cos 2 phi, sin 2 phi) of smears (N, 2, h, w); the torch twin of `field.to_double_angle`."""
    x, y = d[:, :1], d[:, 1:]
    length = torch.sqrt(x * x + y * y + 1e-12)
    return torch.cat([x * x - y * y, 2 * x * y], 1) / length


def squared_error(vector: Tensor, d: Tensor, representation: Representation) -> Tensor:
    """Return the squared error (N, 1, h, w), px^2, of vectors against true smears (N, 2, h, w)."""
    if representation == "local":
        both = [((vector - sign * d) ** 2).sum(1, keepdim=True) for sign in (1, -1)]
        return torch.minimum(*both)
    truth = double_angle(d) if representation == "double" else rightward(d)
    return ((vector - truth) ** 2).sum(1, keepdim=True)


def paper_loss(
    raw: Tensor, target: Tensor, representation: Representation, cross_check: bool, alpha: float
) -> Tensor:
    """Return the loss of a batch, a scalar.

    ``raw`` (N, 3, h, w) are the network's v and w, ``target`` (N, 3, h, w) displacements in pixels and the
    cross-check map (0 or 1), which counts as 0 where a displacement is not finite; the likelihood is left out
    there. ``alpha`` is what 1 / sigma^2 may be where the map is 0.
    """
    finite = torch.isfinite(target[:, :2]).all(1, keepdim=True)
    d = torch.where(finite, target[:, :2], 0.0)
    sigma = sigma_of(raw)
    likelihood = squared_error(raw[:, :2], d, representation) / (2 * sigma**2) + 2 * torch.log(sigma)
    known = torch.where(finite, likelihood, 0.0)
    if not cross_check:
        return known.mean()
    m = torch.where(finite, target[:, 2:3], 0.0)
    return (m * known + torch.relu((1 - m) / sigma**2 - alpha)).mean()


def decoded(raw: Tensor, representation: Representation) -> tuple[Floats, Floats]:
    """Return displacements (N, h, w, 2) and sigmas (N, h, w), px, of raw output (N, 3, h, w)."""
    vector = raw[:, :2].permute(0, 2, 3, 1).numpy()
    return from_double_angle(vector) if representation == "double" else vector, sigma_of(raw)[:, 0].numpy()
