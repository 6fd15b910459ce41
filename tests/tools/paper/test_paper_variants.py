"""The paper's losses by hand, its networks, and runs of variants: they resume exactly and finish once."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from blur2view.smears.field import to_double_angle
from tools.datasets.shards import load_shards, training_record
from tools.metrics import direction_error_deg, epe_s
from tools.paper import crops, paper_variants
from tools.paper.crops import TrainOptions, batches_of
from tools.paper.networks import START_SIGMA, PlainUNet, StemUNet
from tools.paper.paper_loss import (
    Representation,
    decoded,
    double_angle,
    paper_loss,
    rightward,
    sigma_of,
    smear_error,
    target_parts,
)
from tools.paper.paper_variants import ALPHA_STUDY, SIX, TABLE_1, VARIANTS, Variant
from tools.rendering.render import RenderOptions

REPRESENTATIONS: tuple[Representation, ...] = ("local", "restricted", "double")


def grid(*channels: float) -> torch.Tensor:
    """One pixel (1, C, 1, 1)."""
    return torch.tensor(channels, dtype=torch.float32)[None, :, None, None]


def softplus_inverse(sigma: float) -> float:
    return float(np.log(np.expm1(sigma - 0.05)))


W = softplus_inverse(2.0)


def vector_of(d: tuple[float, float], representation: Representation) -> tuple[float, ...]:
    """Give what a network must say of a smear."""
    return tuple(to_double_angle(np.array(d))) if representation == "double" else d


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_loss_is_the_likelihood_worked_out_by_hand(representation: Representation) -> None:
    d = (6.0, 8.0)
    right = grid(*vector_of(d, representation), W)
    assert sigma_of(right).item() == pytest.approx(2)
    for sign in (1, -1):  # the truth has no sign
        target = grid(sign * d[0], sign * d[1], 1)
        perfect = paper_loss(right, target, representation, True, 0.01).item()
        assert perfect == pytest.approx(2 * np.log(2), abs=1e-5)
        off = right + grid(3, 0, 0)
        assert paper_loss(off, target, representation, True, 0.01).item() == pytest.approx(
            2 * np.log(2) + 9 / (2 * 4), abs=1e-5
        )


def test_only_the_restricted_loss_minds_the_sign_of_the_answer() -> None:
    target, turned = grid(6, 8, 1), grid(-6, -8, W)
    assert paper_loss(turned, target, "local", False, 0).item() == pytest.approx(2 * np.log(2), abs=1e-5)
    assert paper_loss(turned, target, "restricted", False, 0).item() == pytest.approx(
        2 * np.log(2) + 400 / 8, abs=1e-4
    )
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


def test_double_angle_is_that_of_the_package() -> None:
    d = np.random.default_rng(0).normal(size=(7, 2)).astype(np.float32)
    mine = double_angle(torch.from_numpy(d)[..., None, None])[..., 0, 0]
    np.testing.assert_allclose(mine, to_double_angle(d), atol=1e-5)


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_right_answers_are_judged_perfect(representation: Representation) -> None:
    rng = np.random.default_rng(1)
    d = rng.normal(0, 8, (1, 2, 6, 8)).astype(np.float32)
    truth = torch.from_numpy(np.concatenate([d, np.ones((1, 1, 6, 8), np.float32)], 1))
    vector = double_angle(truth[:, :2]) if representation == "double" else -truth[:, :2]
    raw = torch.cat([vector, torch.from_numpy(rng.random((1, 1, 6, 8)).astype(np.float32))], 1)
    figures = paper_variants.judged(decoded(raw, representation), truth)
    assert figures["epe_s"] < 0.01 and figures["direction_deg"] < 0.1
    json.dumps(figures)


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


def said_of(d: np.ndarray, sigma: float | np.ndarray = 1.0) -> Tensor:
    """Pack displacements (N, h, w, 2) as a network's double angle and sigma (N, 3, h, w)."""
    one = np.broadcast_to(sigma, d.shape[:-1])[..., None]
    return torch.from_numpy(
        np.concatenate([to_double_angle(d), one], -1).transpose(0, 3, 1, 2).copy()
    ).float()


def test_torch_twins_are_the_packages_double_angle_and_error() -> None:
    d, true = fields(0), fields(1)
    target = target_parts(truth_of(true))
    ours = (target.unit * target.length).permute(0, 2, 3, 1).numpy()
    np.testing.assert_allclose(ours, to_double_angle(true), atol=1e-4)
    np.testing.assert_allclose(target.length[:, 0].numpy(), np.linalg.norm(true, axis=-1), rtol=1e-5)
    np.testing.assert_allclose(smear_error(said_of(d), target)[:, 0], epe_s(d, true), atol=2e-3, rtol=1e-3)


def test_figures_are_the_packages_measures() -> None:
    true, rng = fields(1), np.random.default_rng(2)
    d = 1.2 * true + rng.normal(0, 1, true.shape)
    valid = rng.random(true.shape[:-1]) < 0.7
    sigma = rng.uniform(1, 9, true.shape[:-1]).astype(np.float32)
    figures = paper_variants.judged(said_of(d, sigma), truth_of(true, valid))
    length = np.linalg.norm(true, axis=-1)
    certain = valid & (sigma <= np.quantile(sigma[valid], 0.5, method="lower"))
    assert figures["epe_s"] == pytest.approx(epe_s(d, true)[valid].mean(), rel=1e-3)
    assert figures["epe_s_top50"] == pytest.approx(epe_s(d, true)[certain].mean(), rel=1e-3)
    expected = figures["epe_s_top50"] / length[certain].mean()
    assert figures["epe_s_top50_over_length"] == pytest.approx(expected, rel=1e-4)
    low, high = np.quantile(direction_error_deg(d, true)[valid & (length >= 4)], [0.47, 0.53])
    assert low <= figures["direction_deg"] <= high


@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf])
def test_a_displacement_that_is_not_finite_becomes_zero_and_invalid(poison: float) -> None:
    poisoned = fields(1)
    poisoned[0, 2, 3, 1] = poison
    target = target_parts(truth_of(poisoned))
    assert target.valid[0, 0, 2, 3] == 0 and target.valid.sum() == 71


def test_networks_start_with_no_smear_and_have_the_truths_cells() -> None:
    plain = PlainUNet(width=4, depth=2).eval()
    image = torch.rand(2, 3, 32, 48)
    with torch.no_grad():
        output = plain(image)
        full = plain.head(torch.ones(1, 4, 8, 8))
    assert output.shape == (2, 3, 8, 12) and full.shape == (1, 3, 8, 8)
    for raw in (output, StemUNet().eval()(torch.rand(1, 3, 32, 32)).detach()):
        assert raw[:, :2].abs().mean() < 1 and abs(sigma_of(raw).mean().item() - START_SIGMA) < 1


def test_variants_are_the_papers_six_and_the_study_of_alpha() -> None:
    assert len({(v.representation, v.cross_check) for v in SIX}) == len(SIX) == 6
    assert {v.network for v in TABLE_1} == {"stem", "plain"}
    assert [v.alpha for v in ALPHA_STUDY] == [0.005, 0.01, 0.02, 0.05]
    assert len(VARIANTS) == 6 + 1 + 3  # the study shares one variant with the six


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Make networks narrow, validate on few crops, use one thread: the same sums in the same order."""

    def build(variant: Variant) -> torch.nn.Module:
        if variant.network == "plain":
            return PlainUNet(width=4, depth=2)
        return StemUNet(widths=(16, 24, 32), bottom=1)

    monkeypatch.setattr(paper_variants, "build", build)
    monkeypatch.setattr(crops, "VALIDATION_CROPS", 2)
    monkeypatch.setattr(crops, "VALIDATION_SIDE", 64)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def shards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Render two small scenes."""
    folder, options = tmp_path_factory.mktemp("shards"), RenderOptions(size=(96, 96), smear_px=(4.0, 16.0))
    for seed in range(2):
        training_record(seed, options).save(folder / f"train_{seed:08d}.npz")
    return folder


def options_of(shards: Path, out: Path, steps: int) -> TrainOptions:
    out.mkdir(exist_ok=True)
    return TrainOptions(
        train=shards, val=shards, out=out, steps=steps, batch=2, side=64, workers=0, save_every=2
    )


@pytest.mark.usefixtures("small")
def test_resumed_variant_equals_one_uninterrupted_among_others(shards: Path, tmp_path: Path) -> None:
    parts, whole_run = (options_of(shards, tmp_path / name, 4) for name in ("parts", "whole"))
    scenes, variant = load_shards(shards), SIX[-1]
    whole = paper_variants.train(SIX, 1, whole_run, scenes)[-1]
    half = paper_variants.start(variant, 1, 2e-3, torch.device("cpu"))
    batches = batches_of(scenes, parts, 0)
    for _ in range(2):
        images, targets = next(batches)
        inputs = paper_variants.shared_input(half.network, images)
        paper_variants.advance(half, inputs, targets, parts)
    half.save(tmp_path / "parts" / f"{variant.name}_1.pt")
    other, resumed = paper_variants.train([SIX[0], variant], 1, parts, scenes)
    assert other.step == resumed.step == whole.step == 4
    assert np.isfinite(resumed.history + whole.history).all()
    for name in ("network", "average"):
        found, expected = (getattr(run, name).state_dict().values() for run in (resumed, whole))
        for a, b in zip(found, expected, strict=True):
            assert torch.equal(a, b)


def test_learning_rate_warms_up_over_a_tenth_and_falls_to_a_hundredth(tmp_path: Path) -> None:
    options = TrainOptions(train=tmp_path, val=tmp_path, out=tmp_path, steps=200)
    rate = [paper_variants.learning_rate_at(step, options) for step in range(201)]
    assert rate[0] == pytest.approx(options.learning_rate / 20) and int(np.argmax(rate)) in (19, 20)
    assert rate[200] == pytest.approx(options.learning_rate / 100)


@pytest.mark.usefixtures("small")
def test_every_kind_of_variant_is_trained_once(
    shards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ["stem_local_nomap_0.01", "plain_double_map_0.01"]
    variants = [VARIANTS[name] for name in names]
    options = options_of(shards, tmp_path, 2)
    paper_variants.run_all(variants, [0], options, 1)
    assert capsys.readouterr().out.count("_0: step") == 2
    found = {name: json.loads((tmp_path / f"{name}_0.json").read_text()) for name in names}
    assert [document["steps"] for document in found.values()] == [2, 1]
    for document in found.values():
        assert np.isfinite(document["epe_s_top50"])
    paper_variants.run_all(variants, [0], options, 1)
    assert capsys.readouterr().out == ""
