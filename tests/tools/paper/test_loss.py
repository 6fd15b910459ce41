"""The loss: its torch twins of the package's formulas, its parts, and what must not poison it."""

import numpy as np
import pytest
import torch
from torch import Tensor

from blur2view.metrics import direction_error_deg, epe_s
from blur2view.smears.field import to_double_angle
from tools.paper.loss import Target, loss_of, smear_error, target_parts
from tools.paper.model import decode
from tools.paper.validation import figures_of

ALPHA = 0.01


def fields(seed: int, count: int = 2, cells: int = 6) -> np.ndarray:
    """Draw displacements (count, cells, cells, 2) of 0.1 to 40 px."""
    rng = np.random.default_rng(seed)
    angle, length = (
        rng.uniform(0, 2 * np.pi, (2, count, cells, cells)),
        rng.uniform(0.1, 40, (count, cells, cells)),
    )
    return np.stack([np.cos(angle[0]), np.sin(angle[0])], -1) * length[..., None]


def truth_of(d: np.ndarray, valid: float | np.ndarray = 1.0) -> Tensor:
    """Pack displacements (..., 2) as (N, 3, h, w)."""
    mask = np.broadcast_to(valid, d.shape[:-1])[..., None]
    return torch.from_numpy(np.concatenate([d, mask], -1).transpose(0, 3, 1, 2).copy()).float()


def raw_of(d: np.ndarray, sigma: float = 1.0, angle: float = 0.1) -> Tensor:
    """Heads (N, 5, h, w) that decode to these displacements."""
    length = np.linalg.norm(d, axis=-1, keepdims=True)
    heads = [3 * to_double_angle(d) / length, np.log1p(length), np.full_like(length, np.log(sigma))]
    heads.append(np.full_like(length, np.log(angle)))
    return torch.from_numpy(np.concatenate(heads, -1).transpose(0, 3, 1, 2).copy()).float()


def test_target_is_the_packages_double_angle() -> None:
    d = fields(0)
    target = target_parts(truth_of(d))
    ours = (target.unit * target.length).permute(0, 2, 3, 1).numpy()
    np.testing.assert_allclose(ours, to_double_angle(d), atol=1e-4)
    np.testing.assert_allclose(target.length[:, 0].numpy(), np.linalg.norm(d, axis=-1), rtol=1e-5)


def test_smear_error_is_the_packages() -> None:
    d, true = fields(0), fields(1)
    error = smear_error(decode(raw_of(d)), target_parts(truth_of(true)))[:, 0].numpy()
    np.testing.assert_allclose(error, epe_s(d, true), atol=2e-3, rtol=1e-3)


def test_figures_are_the_packages_measures() -> None:
    true, rng = fields(1), np.random.default_rng(2)
    d = 1.2 * true + rng.normal(0, 1, true.shape)
    valid = rng.random(true.shape[:-1]) < 0.7
    decoded = decode(raw_of(d))
    decoded[:, 2] = torch.from_numpy(rng.uniform(1, 9, true.shape[:-1]))
    figures = figures_of(decoded, truth_of(true, valid))
    long = valid & (np.linalg.norm(true, axis=-1) >= 4)
    certain = valid & (
        decoded[:, 2].numpy() <= np.quantile(decoded[:, 2].numpy()[valid], 0.5, method="lower")
    )
    length = np.linalg.norm(true, axis=-1)
    assert figures.epe_s == pytest.approx(epe_s(d, true)[valid].mean(), rel=1e-3)
    assert figures.epe_s_top50 == pytest.approx(epe_s(d, true)[certain].mean(), rel=1e-3)
    expected = figures.epe_s_top50 / length[certain].mean()
    assert figures.epe_s_top50_over_length == pytest.approx(expected, rel=1e-4)
    degrees = direction_error_deg(d, true)
    low, high = np.quantile(degrees[long], [0.47, 0.53])
    assert low <= figures.direction_deg <= high
    assert figures.length_ratio == pytest.approx(1.2, abs=0.03)
    assert 0 < figures.length_spread < 0.2


def test_perfect_prediction_has_almost_no_orientation_and_length_loss() -> None:
    d = fields(0)
    perfect, other = (loss_of(raw_of(guess), truth_of(d), ALPHA) for guess in (d, fields(1)))
    assert perfect.orientation < 0.02 and perfect.length < 1e-4
    assert other.orientation > 0.5 and other.length > 0.1
    flipped = loss_of(raw_of(-d), truth_of(d), ALPHA)
    assert flipped.total.item() == pytest.approx(perfect.total.item(), abs=1e-4)


def test_direction_of_a_tiny_smear_hardly_counts() -> None:
    turned = np.stack([-fields(0)[..., 1], fields(0)[..., 0]], -1)  # 90 degrees wrong: the worst chord, 2
    long = loss_of(raw_of(turned), truth_of(fields(0) * 100), ALPHA).orientation.item()
    unit = fields(0) / np.linalg.norm(fields(0), axis=-1, keepdims=True)
    tiny = loss_of(raw_of(turned), truth_of(0.2 * unit), ALPHA).orientation.item()
    assert long == pytest.approx(2, abs=0.02)
    assert tiny == pytest.approx(2 * 0.04 / 4.04, rel=0.01)


def turned_by(true: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Turn displacements (..., 2) by angles (...) in radians."""
    x, y = true[..., 0], true[..., 1]
    return np.stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y], -1)


def test_end_point_loss_is_the_packages_error_over_the_length() -> None:
    d, true = fields(0), fields(1)
    expected = (epe_s(d, true) / (np.linalg.norm(true, axis=-1) + 4)).mean()
    assert loss_of(raw_of(d), truth_of(true), ALPHA).end_point.item() == pytest.approx(expected, rel=1e-3)


def test_end_point_loss_asks_for_shorter_smears_where_the_direction_is_wrong() -> None:
    true = fields(1)
    wrong = turned_by(true, np.full(true.shape[:-1], np.radians(40)))
    losses = [
        loss_of(raw_of(f * wrong), truth_of(true), ALPHA).end_point.item()
        for f in (0.6, np.cos(np.radians(40)), 1)
    ]
    assert losses[1] == min(losses)


def test_best_sigma_is_the_expected_error() -> None:
    d, true = fields(0, 8), fields(1, 8)
    mean = epe_s(d, true).mean()
    losses = [loss_of(raw_of(d, mean * f), truth_of(true), ALPHA).sigma.item() for f in (0.8, 1.0, 1.25)]
    assert losses[1] == min(losses) == pytest.approx(1 + np.log(mean), rel=1e-3)


def test_hidden_pixels_ask_for_a_sigma_of_at_least_the_bound() -> None:
    d, bound = fields(0), 1 / np.sqrt(ALPHA)
    sigma = {
        s: loss_of(raw_of(d, s), truth_of(d, 0.0), ALPHA).sigma.item()
        for s in (2.0, 0.999 * bound, 2 * bound)
    }
    assert sigma[2.0] == pytest.approx(1 / 4 - ALPHA, rel=1e-4)
    assert sigma[0.999 * bound] > 0 and sigma[2 * bound] == 0


def test_uncertainty_does_not_reach_orientation_and_length() -> None:
    raw = raw_of(fields(0)).requires_grad_()
    torch.autograd.backward(loss_of(raw, truth_of(fields(1)), ALPHA).sigma)
    assert raw.grad is not None
    assert not raw.grad[:, :3].any() and raw.grad[:, 3].abs().sum() > 0


def test_hidden_pixels_weigh_a_fifth_in_orientation_and_length() -> None:
    seen, hidden = (loss_of(raw_of(fields(0)), truth_of(fields(1), valid), ALPHA) for valid in (1.0, 0.0))
    assert hidden.orientation.item() == pytest.approx(0.2 * seen.orientation.item())
    assert hidden.length.item() == pytest.approx(0.2 * seen.length.item())


@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf])
def test_displacement_that_is_not_finite_does_not_poison_the_loss(poison: float) -> None:
    true, valid = fields(1), np.ones((2, 6, 6))
    valid[0, 2, 3] = 0
    poisoned, zero = true.copy(), true.copy()
    poisoned[0, 2, 3, 1], zero[0, 2, 3] = poison, 0
    raw = raw_of(fields(0)).requires_grad_()
    loss = loss_of(raw, truth_of(poisoned, valid), ALPHA).total
    assert loss.item() == pytest.approx(loss_of(raw, truth_of(zero, valid), ALPHA).total.item())
    torch.autograd.backward(loss)
    assert raw.grad is not None and torch.isfinite(raw.grad).all()
    # even where it is called valid
    target: Target = target_parts(truth_of(poisoned, 1.0))
    assert target.valid[0, 0, 2, 3] == 0 and target.valid.sum() == 71


def test_gradient_is_finite_at_zero_length_and_at_a_perfect_guess() -> None:
    for guess, true in ((fields(0), 0 * fields(0)), (fields(0), fields(0)), (1e-6 * fields(0), fields(0))):
        raw = raw_of(guess).requires_grad_()
        torch.autograd.backward(loss_of(raw, truth_of(true), ALPHA).total)
        assert raw.grad is not None and torch.isfinite(raw.grad).all()


def test_best_angular_sigma_is_the_expected_angle() -> None:
    true = 100 * fields(1, 8)  # so long that every one counts alike
    turn = np.random.default_rng(3).normal(0, 0.2, true.shape[:-1])
    d = turned_by(true, turn)
    mean = np.abs(turn).mean()
    losses = [
        loss_of(raw_of(d, angle=mean * f), truth_of(true), ALPHA).angle.item() for f in (0.8, 1.0, 1.25)
    ]
    assert losses[1] == min(losses) == pytest.approx(1 + np.log(mean), rel=0.01)
