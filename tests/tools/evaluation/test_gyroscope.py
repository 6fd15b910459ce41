"""Figures of smears against measured ones: known errors are found, up to sign."""

import numpy as np
import pytest

from blur2view.smears.field import SmearField
from tools.evaluation.gyroscope import figures_of, page, pairs_of
from tools.evaluation.smear_figures import lean_deg


def field_of(displacement: tuple[float, float], sigma_rad: np.ndarray) -> SmearField:
    """Return one smear everywhere."""
    shape = sigma_rad.shape
    return SmearField(
        displacement=np.full((*shape, 2), displacement, np.float32),
        sigma_px=np.ones(shape, np.float32),
        sigma_rad=sigma_rad,
    )


@pytest.mark.parametrize("sign", [1, -1])
def test_a_turn_and_a_factor_are_measured(sign: int) -> None:
    turned = 1.2 * 20 * np.array([np.cos(0.05), np.sin(0.05)])
    smear = np.full((8, 12, 2), (20 * sign, 0), np.float16)
    field = field_of(tuple(turned), np.full((32, 48), 0.1, np.float32))
    figures = figures_of(*pairs_of(field, {"smear": smear}))
    assert figures.length_px == 20
    assert figures.direction_deg == pytest.approx(np.degrees(0.05), rel=1e-5)
    assert figures.signed_deg_top50 == pytest.approx(np.degrees(0.05), rel=1e-5)
    assert (figures.length_ratio, figures.length_spread) == pytest.approx((1.2, 0), abs=1e-6)


def test_the_surer_half_is_judged_apart() -> None:
    field = field_of((20, 0), np.repeat(np.array([[0.1] * 24 + [0.5] * 24], np.float32), 32, 0))
    smear = np.zeros((8, 12, 2), np.float32)
    smear[:, :6], smear[:, 6:] = (20, 0), (0, 20)
    figures = figures_of(*pairs_of(field, {"smear": smear}))
    assert figures.direction_deg_top50 == pytest.approx(0, abs=1e-5)
    assert figures.direction_deg == pytest.approx(45)
    assert "| median | 20.0 |" in page({"one": figures, "other": figures})[-1]


def test_flow_counts_where_it_is_valid_and_long() -> None:
    flow, valid = np.full((8, 12, 2), (6, 0), np.float16), np.ones((8, 12), bool)
    flow[0], valid[:, 0] = (1, 0), False
    field = field_of((6, 0), np.full((32, 48), 0.1, np.float32))
    read, true, _ = pairs_of(field, {"flow": flow, "valid": valid})
    assert len(read) == len(true) == 7 * 11


@pytest.mark.parametrize("axis", [0, 90, 180, 270])
@pytest.mark.parametrize("apart", [20, -20])
def test_a_lean_towards_the_axes_is_positive_on_both_sides(axis: int, apart: int) -> None:
    def smear(degrees: float) -> np.ndarray:
        return np.array([[np.cos(np.radians(degrees)), np.sin(np.radians(degrees))]])

    assert lean_deg(smear(axis + 0.9 * apart), smear(axis + apart)) == pytest.approx(2)
    assert lean_deg(-smear(axis + 1.2 * apart), smear(axis + apart)) == pytest.approx(-4)
