"""The paper's losses by hand, and a page of trainings that go on where they were."""

from pathlib import Path

import numpy as np
import pytest
import torch

from blur2view.networks.spectra import LAGS
from blur2view.smears.grid import to_double_angle
from blur2view.smears.likelihood import DIRECTIONS
from tools.paper import losses
from tools.paper.losses import Representation, Variant, main, paper_loss
from tools.training.reader import SCALARS

REPRESENTATIONS: tuple[Representation, ...] = ("local", "restricted", "double")
SIGMA = 2.0


def raw_of(vector: np.ndarray, sigma: float = SIGMA) -> torch.Tensor:
    """Return v and w (1, 3) of one cell."""
    w = np.log(np.expm1(sigma - losses.MIN_SIGMA_PX))
    return torch.tensor([[*vector, w]], dtype=torch.float32)


def loss_at(raw: torch.Tensor, d: np.ndarray, valid: float, **variant: object) -> torch.Tensor:
    """Return the loss of one cell with one smear."""
    smear = torch.tensor(d, dtype=torch.float32).reshape(1, 1, 2)
    return paper_loss(raw, smear, torch.tensor([[valid]]), Variant(**variant))  # type: ignore[arg-type]


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_likelihood_by_hand(representation: Representation) -> None:
    d = np.array([6.0, 8.0])
    right = to_double_angle(d) if representation == "double" else d
    for sign in (1, -1):  # the truth has no sign
        for off in (0.0, 3.0):
            raw = raw_of(right + [off, 0])
            found = loss_at(raw, sign * d, 1.0, representation=representation)
            assert found.item() == pytest.approx(2 * np.log(SIGMA) + off**2 / (2 * SIGMA**2), abs=1e-4)


@pytest.mark.parametrize("representation", REPRESENTATIONS)
def test_map_bounds_certainty_where_the_cross_check_fails(representation: Representation) -> None:
    raw, d = raw_of(np.array([50.0, 50.0]), 0.5).requires_grad_(), np.ones(2)
    loss = loss_at(raw, d, 0.0, representation=representation)
    assert loss.item() == pytest.approx(1 / 0.25 - 0.01, rel=1e-5)
    torch.autograd.backward(loss)
    assert raw.grad is not None and not raw.grad[:, :2].any() and raw.grad[:, 2] < 0
    assert loss_at(raw_of(d, 100.0), d, 0.0, representation=representation).item() == 0
    assert loss_at(raw, d, 0.0, representation=representation, cross_check=False).item() > 100


def batch(seed: int) -> dict[str, torch.Tensor]:
    """Return examples of any values in two octaves."""
    rng = np.random.default_rng(seed)
    arrays: dict[str, np.ndarray] = {}
    for k, (h, w) in enumerate(((8, 10), (4, 5))):
        arrays[f"C{k}"] = rng.normal(size=(2, h, w, DIRECTIONS, LAGS)).astype(np.float16)
        arrays[f"s{k}"] = rng.normal(size=(2, h, w, SCALARS)).astype(np.float16)
        arrays[f"d{k}"] = rng.normal(0, 9, (2, h, w, 16, 2)).astype(np.float16)
        arrays[f"v{k}"] = rng.random((2, h, w, 16)) < 0.8
    return {name: torch.from_numpy(array).float() for name, array in arrays.items()}


@pytest.mark.slow
def test_every_loss_is_trained_once_and_fills_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(losses, "SEEDS", (0,))
    monkeypatch.setattr(losses, "VARIANTS", losses.VARIANTS[4:6])
    (tmp_path / "work").mkdir()
    torch.save([[batch(0)], [batch(1)]], tmp_path / "work" / "examples.pt")
    for trainings in (2, 0):
        out = tmp_path / f"{trainings}.md"
        main([tmp_path], work=tmp_path / "work", steps=1, out=out)
        assert capsys.readouterr().out.count('"step": 1') == trainings
    text = out.read_text()
    assert text == (tmp_path / "2.md").read_text() and "nan" not in text
    assert text.count("| double, with map | 0.01 | 1 |") == 1
