"""The paper's losses by hand, its network, and runs of variants."""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from blur2view.smears.field import to_double_angle
from tools.datasets.shards import training_record
from tools.metrics import epe_s
from tools.pages import finished_lines
from tools.paper import crops, experiments, paper_variants
from tools.paper.networks import START_SIGMA, StemUNet
from tools.paper.paper_loss import Representation, decoded, double_angle, paper_loss, rightward, sigma_of
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


def test_only_the_restricted_loss_minds_the_sign_of_the_answer() -> None:
    target, turned = grid(6, 8, 1), grid(-6, -8, W)
    for representation, error in (("local", 0), ("restricted", 400)):
        loss = paper_loss(turned, target, representation, False, 0).item()  # type: ignore[arg-type]
        assert loss == pytest.approx(2 * np.log(2) + error / 8, abs=1e-4)
    upright = torch.cat([grid(0.0, -5.0), grid(0.0, 5.0), grid(-1.0, 5.0)])
    np.testing.assert_array_equal(rightward(upright)[..., 0, 0], [[0, 5], [0, 5], [1, -5]])


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


def test_truth_that_is_not_finite_spoils_nothing() -> None:
    raw = torch.zeros(1, 3, 1, 2, requires_grad=True)
    target = torch.tensor([[[[np.nan, 3.0]], [[1.0, 4.0]], [[1.0, 1.0]]]])
    for check in (True, False):
        loss = paper_loss(raw, target, "double", check, 0.01)
        (gradient,) = torch.autograd.grad(loss, raw)
        assert torch.isfinite(loss) and torch.isfinite(gradient).all() and gradient[..., 1].any()


def fields(seed: int, count: int = 2, cells: int = 6) -> np.ndarray:
    """Draw displacements (count, cells, cells, 2) of 0.1 to 40 px."""
    rng = np.random.default_rng(seed)
    shape = count, cells, cells
    angle, length = rng.uniform(0, 2 * np.pi, shape), rng.uniform(0.1, 40, shape)
    return np.stack([np.cos(angle), np.sin(angle)], -1) * length[..., None]


def truth_of(d: np.ndarray, valid: float | np.ndarray = 1.0) -> Tensor:
    """Pack displacements (N, h, w, 2) as (N, 3, h, w)."""
    mask = np.broadcast_to(valid, d.shape[:-1])[..., None]
    return torch.from_numpy(np.concatenate([d, mask], -1).transpose(0, 3, 1, 2).copy()).float()


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_right_answers_are_decoded_and_judged_perfect(representation: Representation) -> None:
    truth = truth_of(fields(1))
    d = truth[:, :2].permute(0, 2, 3, 1).numpy()
    vector = double_angle(truth[:, :2])
    np.testing.assert_allclose(vector.permute(0, 2, 3, 1), to_double_angle(d), atol=1e-4)
    vector = vector if representation == "double" else -truth[:, :2]
    displacement, sigma = decoded(torch.cat([vector, torch.rand(2, 1, 6, 6)], 1), representation)
    figures = paper_variants.judged(displacement, sigma, truth)
    assert figures["epe_s_left"] < 0.01 and figures["direction_deg_top50"] < 0.1 and (sigma > 0.05).all()


def test_figures_are_those_of_valid_cells_and_of_the_surer_half() -> None:
    true, rng = fields(1), np.random.default_rng(2)
    d = 1.2 * true + rng.normal(0, 1, true.shape)
    valid = rng.random(true.shape[:-1]) < 0.7
    sigma = rng.uniform(1, 9, true.shape[:-1]).astype(np.float32)
    figures = paper_variants.judged(d, sigma, truth_of(true, valid))
    error, length = epe_s(d, true), np.linalg.norm(true, axis=-1)
    certain = valid & (sigma <= np.quantile(sigma[valid], 0.5, method="lower"))
    assert figures["epe_s_top50"] == pytest.approx(error[certain].mean(), rel=1e-3)
    expected = figures["epe_s_top50"] / length[certain].mean()
    assert figures["epe_s_top50_over_length"] == pytest.approx(expected, rel=1e-4)
    assert figures["epe_s_oracle"] < figures["epe_s_left"]


def test_networks_start_with_no_smear_and_have_the_truths_cells() -> None:
    raw = StemUNet().eval()(torch.rand(1, 3, 32, 48)).detach()
    assert raw.shape == (1, 3, 8, 12)
    assert raw[:, :2].abs().mean() < 1 and abs(sigma_of(raw).mean().item() - START_SIGMA) < 1


@pytest.mark.slow
def test_every_seed_of_every_variant_is_trained_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paper_variants, "StemUNet", lambda: StemUNet(widths=(16, 24, 32), bottom=1))
    monkeypatch.setattr(crops, "VALIDATION_CROPS", 2)
    monkeypatch.setattr(crops, "VALIDATION_SIDE", 64)
    monkeypatch.setattr(experiments, "render_set", lambda *_: None)
    for seed, folder in enumerate(("train", "val")):
        (tmp_path / folder).mkdir()
        record = training_record(seed, RenderOptions(size=(96, 96), smear_px=(4.0, 16.0)))
        record.save(tmp_path / folder / "0.npz")
    plan = experiments.Plan(photos=None, work=tmp_path, shards=tmp_path, scenes=tmp_path, results=tmp_path)
    for seeds in ((0,), (0, 1)):
        monkeypatch.setattr(experiments, "SEEDS", seeds)
        experiments.train(plan, TrainOptions(steps=2, batch=2, side=64, workers=0))
    first, second = finished_lines(tmp_path / "table1.jsonl")[1:]
    assert set(first["runs"]) == {variant.name for variant in VARIANTS} and len(VARIANTS) == 9
    assert first["runs"] != second["runs"] and (first["seed"], second["seed"]) == (0, 1)
    assert all(np.isfinite([*one["history"], one["epe_s_top50"]]).all() for one in first["runs"].values())
