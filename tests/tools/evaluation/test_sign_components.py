"""The study of sign components: judged against known orders, on few scenes."""

import numpy as np
import pytest

from blur2view.smears.field import SmearField
from blur2view.smears.sign_components import SignComponents
from tools.datasets.synthetic_matches import SyntheticOptions, synthetic_smears
from tools.evaluation import sign_components as study


def test_wrong_share_counts_the_minority_of_every_component() -> None:
    components = SignComponents(
        label=np.array([0, 0, 0, 0, 1, 1, 2]), sign=np.array([1.0, 1, -1, 1, 1, -1, 1])
    )
    assert study.wrong_share(components, components.sign) == 0
    assert study.wrong_share(components, -components.sign) == 0
    order = components.sign * [1, 1, 1, -1, -1, -1, 1]
    assert np.isclose(study.wrong_share(components, order), 1 / 7)
    assert study.wrong_share(components, order * [0, 0, 0, 0, 1, 1, 1]) == 0
    assert study.wrong_share(components, np.zeros(7)) == 0


def test_field_case_knows_the_order_where_smear_and_truth_agree() -> None:
    truth = np.zeros((30, 40, 2), np.float16)
    truth[:, :20, 0] = 8.0
    truth[:, 20:, 1] = 8.0  # the field says otherwise there
    measurable = np.ones((30, 40), bool)
    measurable[:10] = False
    displacement = np.tile(np.array([8.0, 0.5], np.float32), (120, 160, 1))
    displacement[::2] *= -1
    field = SmearField(displacement=displacement, sigma_px=np.ones((120, 160), np.float32))
    case = study.field_case(field, truth, measurable)
    x, y = case.matches.midpoint.T
    known = (x < 80) & (y > 40)
    assert known.any() and (~known).any()
    assert (case.order[~known] == 0).all()
    assert (case.order[known] == np.sign(case.matches.displacement[known, 0])).all()


def test_measure_finds_an_exact_scene_s_orders() -> None:
    (case,) = study.synthetic_cases(SyntheticOptions(noise_px=0.0, outliers=0.0), 1)
    figures = study.measure(case)
    assert figures.wrong < 0.01
    assert figures.alone < 0.05
    assert figures.largest <= figures.three <= 1
    assert figures.patterns.shape == (study.SAMPLES,) and np.median(figures.patterns) <= 8


def test_groupings_range_from_right_to_wrong() -> None:
    scene = synthetic_smears(1, SyntheticOptions(outliers=0.0))
    order = np.where(scene.swapped, -1.0, 1.0)
    found = {name: study.wrong_share(grouping, order) for name, grouping in study.groupings(scene).items()}
    assert found["none"] == found["one component, the true signs"] == 0
    assert 0.25 < found["one component, 30 % of the signs wrong"] < 0.35
    assert found["one component, the left half wrong"] > 0.49
    assert found["one component, random signs"] > 0.4


def test_report_has_a_row_per_kind_of_field(monkeypatch: pytest.MonkeyPatch) -> None:
    few = {"one": SyntheticOptions(count=200), "two": SyntheticOptions(kind="scattered", count=200)}
    monkeypatch.setattr(study, "SYNTHETIC", few)
    monkeypatch.setattr(study, "WRONG", {"one": few["one"]})
    text = study.report(None, None, 1)
    assert text.count("\n| one |") == 1 + len(study.groupings(synthetic_smears(0, few["one"])))
    assert "\n| two |" in text
