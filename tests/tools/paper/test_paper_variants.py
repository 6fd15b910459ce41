"""The paper's losses by hand, its network, and runs of variants."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from blur2view.smears.field import to_double_angle
from tools.datasets.shards import training_record, write_shards
from tools.pages import finished_lines
from tools.paper import experiments, paper_variants
from tools.paper.networks import StemUNet
from tools.paper.paper_loss import Representation, paper_loss
from tools.paper.paper_variants import VARIANTS, TrainOptions
from tools.rendering.render import RenderOptions

REPRESENTATIONS: tuple[Representation, ...] = ("local", "restricted", "double")


def grid(*channels: float) -> torch.Tensor:
    """One pixel (1, C, 1, 1)."""
    return torch.tensor(channels, dtype=torch.float32)[None, :, None, None]


def softplus_inverse(sigma: float) -> float:
    return float(np.log(np.expm1(sigma - 0.05)))


W = softplus_inverse(2.0)


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_loss_is_the_likelihood_worked_out_by_hand(representation: Representation) -> None:
    d = np.array([6.0, 8.0])
    right = grid(*(to_double_angle(d) if representation == "double" else d), W)
    for sign in (1, -1):  # the truth has no sign
        for off, error in ((0, 0), (3, 9)):
            raw, target = right + grid(off, 0, 0), grid(*(sign * d), 1)
            expected = 2 * np.log(2) + error / (2 * 4)
            loss = paper_loss(raw, target, representation, True, 0.01)
            assert loss.item() == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_map_bounds_certainty_where_the_cross_check_fails(representation: Representation) -> None:
    raw, hidden = grid(50, 50, softplus_inverse(0.5)).requires_grad_(), grid(1, 1, 0)
    loss = paper_loss(raw, hidden, representation, True, 0.01)
    assert loss.item() == pytest.approx(1 / 0.25 - 0.01, rel=1e-5)
    torch.autograd.backward(loss)
    assert raw.grad is not None and not raw.grad[:, :2].any() and raw.grad[:, 2] < 0
    sure = paper_loss(grid(50, 50, 100.0), hidden, representation, True, 0.01)
    assert sure.item() == 0  # 1 / sigma^2 below alpha costs nothing
    without = paper_loss(raw, hidden, representation, False, 0.01).item()
    assert without > 100  # there the wrong vector counts


@pytest.mark.slow
def test_every_seed_of_every_variant_is_trained_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paper_variants, "StemUNet", lambda: StemUNet(widths=(16, 24, 32), bottom=1))
    monkeypatch.setattr(paper_variants, "VALIDATION_CROPS", 2)
    monkeypatch.setattr(paper_variants, "VALIDATION_SIDE", 64)
    monkeypatch.setattr(experiments, "write_scenes", lambda *_: None)
    for seed, folder in enumerate(("train", "val")):
        record = partial(training_record, options=RenderOptions(size=(96, 96), smear_px=(4.0, 16.0)))
        write_shards(tmp_path / folder, [seed], lambda seed, record=record: [record(seed)])  # type: ignore[misc]
    for seeds in ((0,), (0, 1)):
        monkeypatch.setattr(experiments, "SEEDS", seeds)
        options = TrainOptions(steps=2, batch=2, side=64, workers=0)
        experiments.train(None, tmp_path, tmp_path / "table1.jsonl", options)
    first, second = finished_lines(tmp_path / "table1.jsonl")[1:]
    assert set(first["runs"]) == {variant.name for variant in VARIANTS} and len(VARIANTS) == 9
    assert first["runs"] != second["runs"] and (first["seed"], second["seed"]) == (0, 1)
    assert all(np.isfinite([*one["history"], one["epe_s_top50"]]).all() for one in first["runs"].values())
