"""Figures of a network on fixed crops of rendered scenes that training never saw."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from blur2view.metrics import DIRECTION_MIN_PX
from tools.datasets.shards import load_shards
from tools.paper.crops import CropStream
from tools.paper.loss import smear_error, target_parts
from tools.paper.model import SmearUNet, decode

CROPS, SIDE, SEED = 128, 240, 12345


@dataclass(frozen=True, kw_only=True)
class Figures:
    """How good a network is, over valid pixels; "top50" means the more certain half by sigma.

    Attributes
    ----------
    epe_s, epe_s_top50 : float
        Mean EPE-S in pixels.
    epe_s_top50_over_length : float
        The latter divided by the mean true length there.
    direction_deg, direction_deg_top50 : float
        Median direction error of smears of at least 4 px.
    length_ratio, length_spread : float
        Median of predicted over true length, and the median deviation of its logarithm.
    """

    epe_s: float
    epe_s_top50: float
    epe_s_top50_over_length: float
    direction_deg: float
    direction_deg_top50: float
    length_ratio: float
    length_spread: float


def validation_crops(folder: Path) -> tuple[Tensor, Tensor]:
    """Cut fixed crops of held-out scenes: the same pictures, cameras and noise for every run."""
    return CropStream(load_shards(folder), seed=SEED, batch=CROPS, side=SIDE).make(0)


@torch.no_grad()
def predict(network: SmearUNet, images: Tensor, device: torch.device) -> Tensor:
    """Run the network in inference mode on images (N, 3, H, W), 32 at a time: decoded (N, 4, H/4, W/4)."""
    was_training = network.training
    network.eval()
    parts = [decode(network(images[k : k + 32].to(device))).cpu() for k in range(0, len(images), 32)]
    network.train(was_training)
    return torch.cat(parts)


def figures_of(decoded: Tensor, truth: Tensor) -> Figures:
    """Compare decoded predictions (N, 3 or 4, h, w) with the truth (N, 3, h, w) of the crops."""
    target = target_parts(truth)
    seen = target.valid > 0
    error, sigma, true = smear_error(decoded, target)[seen], decoded[:, 2:3][seen], target.length[seen]
    certain, long = sigma <= sigma.median(), true >= DIRECTION_MIN_PX
    mine = torch.linalg.norm(decoded[:, :2], dim=1, keepdim=True)
    cosine = ((decoded[:, :2] * target.unit).sum(1, keepdim=True) / (mine + 1e-6)).clamp(-1, 1)[seen]
    angle_deg = torch.rad2deg(torch.acos(cosine)) / 2
    ratio = torch.log((mine[seen][long] + 0.1) / true[long])
    return Figures(
        epe_s=float(error.mean()),
        epe_s_top50=float(error[certain].mean()),
        epe_s_top50_over_length=float(error[certain].mean() / true[certain].mean()),
        direction_deg=float(angle_deg[long].median()),
        direction_deg_top50=float(angle_deg[long & certain].median()),
        length_ratio=float(ratio.median().exp()),
        length_spread=float((ratio - ratio.median()).abs().median()),
    )
