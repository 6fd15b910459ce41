"""Training loss and the errors it is made of, in torch.

Five parts: orientation as a chord on the double-angle circle, weighted down for tiny smears; log length; the
end-point error in proportion to the length, which shortens what is uncertain; the uncertainty of the angle;
and that of the whole, by the negative log likelihood of the end-point error with the paper's cross-check
term. The gradients of the last two do not reach orientation and length. The torch twins of
:mod:`blur2view.smears.field` and :mod:`blur2view.metrics` are tested equal to them.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as nnf

from tools.paper.model import decode

HIDDEN_WEIGHT = 0.2
"""Weight of orientation and length where an end is hidden: the truth is known, but shows less."""
CLEAR_PX = 2.0
"""Length at which a smear's orientation counts half."""


@dataclass(frozen=True, kw_only=True)
class Target:
    """Truth of a batch: unit double angle (N, 2, h, w), length in px and validity (N, 1, h, w)."""

    unit: Tensor
    length: Tensor
    valid: Tensor


@dataclass(frozen=True, kw_only=True)
class Loss:
    """The five parts, scalars."""

    orientation: Tensor
    length: Tensor
    end_point: Tensor
    sigma: Tensor
    angle: Tensor

    @property
    def total(self) -> Tensor:
        """Weigh and sum the parts."""
        return self.orientation + 4 * self.length + self.end_point + 0.25 * self.sigma + 0.1 * self.angle

    def detached(self) -> Loss:
        """Return the values without the graph that computed them."""
        return Loss(**{name: part.detach() for name, part in vars(self).items()})

    def values(self) -> dict[str, float]:
        """Return plain numbers, for the log."""
        return {name: float(part) for name, part in vars(self.detached()).items()}


def target_parts(target: Tensor) -> Target:
    """Split the truth (N, 3, h, w): displacement x, y in px and validity.

    A displacement that is not finite becomes zero and invalid: NaN times a mask of zero would still be NaN.
    """
    finite = torch.isfinite(target[:, :2]).all(1, keepdim=True)
    clean = torch.where(finite, target, 0.0)
    x, y, valid = clean[:, :1], clean[:, 1:2], clean[:, 2:]
    length = torch.sqrt(x * x + y * y + 1e-12)
    unit = torch.cat([(x * x - y * y), 2 * x * y], 1) / (length * length)
    return Target(unit=unit, length=length, valid=valid)


def smear_error(predicted: Tensor, target: Target) -> Tensor:
    """Return EPE-S (N, 1, h, w), px, of decoded predictions (N, 3 or 4, h, w): min(|d - d*|, |d + d*|)."""
    double, length = predicted[:, :2], target.length
    mine = torch.sqrt((double * double).sum(1, keepdim=True) + 1e-12)
    cosine = ((double * target.unit).sum(1, keepdim=True) / mine).clamp(-1, 1)
    half_cosine = torch.sqrt((1 + cosine) / 2 + 1e-12)  # |cos| of the angle between the smears themselves
    return torch.sqrt((mine - length) ** 2 + 2 * mine * length * (1 - half_cosine) + 1e-6)


def orientation_loss(raw: Tensor, target: Target) -> Tensor:
    """Return the chord (N, 1, h, w) between unit double angles, weighted down for tiny smears."""
    mine = raw[:, :2] / torch.sqrt((raw[:, :2] ** 2).sum(1, keepdim=True) + 1e-4)
    chord = torch.sqrt(((mine - target.unit) ** 2).sum(1, keepdim=True) + 1e-4)
    return clarity(target) * chord


def end_point_loss(decoded: Tensor, target: Target) -> Tensor:
    """Return EPE-S over the length (N, 1, h, w) of decoded predictions, 2 CLEAR_PX added to the length."""
    return smear_error(decoded, target) / (target.length + 2 * CLEAR_PX)


def sigma_loss(raw: Tensor, target: Target, alpha: float) -> Tensor:
    """Return sigma's part (N, 1, h, w): Laplace likelihood where valid, the paper's bound elsewhere.

    Laplace: the best sigma is the expected end-point error. The bound is ReLU(1 / sigma^2 - alpha).
    """
    error = smear_error(decode(raw), target).detach()
    log_sigma = raw[:, 3:4].clamp(-3.0, 4.5)
    likelihood = error * torch.exp(-log_sigma) + log_sigma
    hidden = torch.relu(torch.exp(-2 * log_sigma) - alpha)
    return target.valid * likelihood + (1 - target.valid) * hidden


def angle_loss(raw: Tensor, target: Target) -> Tensor:
    """Return the angular uncertainty's part (N, 1, h, w): Laplace likelihood, for all but tiny smears."""
    mine = raw[:, :2] / torch.sqrt((raw[:, :2] ** 2).sum(1, keepdim=True) + 1e-4)
    cosine = (mine * target.unit).sum(1, keepdim=True).clamp(-0.9999, 0.9999)
    error = (torch.acos(cosine) / 2).detach()
    log_angle = raw[:, 4:5].clamp(-5.0, 0.5)
    return clarity(target) * (error * torch.exp(-log_angle) + log_angle)


def clarity(target: Target) -> Tensor:
    """Weigh orientations (N, 1, h, w): a half for smears of CLEAR_PX, towards one for longer ones."""
    return target.length**2 / (target.length**2 + CLEAR_PX**2)


def loss_of(raw: Tensor, truth: Tensor, alpha: float) -> Loss:
    """Compute the loss of a batch.

    Parameters
    ----------
    raw : Tensor of shape (N, 5, h, w)
        The network's heads.
    truth : Tensor of shape (N, 3, h, w)
        Displacement in pixels and validity (0 or 1).
    alpha : float
        The paper's bound on 1 / sigma^2 where the cross-check fails.
    """
    target = target_parts(truth)
    weight = target.valid + HIDDEN_WEIGHT * (1 - target.valid)
    miss = nnf.smooth_l1_loss(raw[:, 2:3], torch.log1p(target.length), reduction="none", beta=0.1)
    return Loss(
        orientation=(weight * orientation_loss(raw, target)).mean(),
        length=(weight * miss).mean(),
        end_point=(weight * end_point_loss(decode(raw), target)).mean(),
        sigma=sigma_loss(raw, target, alpha).mean(),
        angle=(target.valid * angle_loss(raw, target)).mean(),
    )
