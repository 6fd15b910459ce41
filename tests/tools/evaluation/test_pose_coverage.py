"""The study of coverage: what is observed, and its table."""

import numpy as np

from tools.evaluation.pose_coverage import CASES, markdown, observed, outcome


def test_observed_smears_repeat_and_keep_their_truth() -> None:
    for case in CASES[::3]:
        (scene, one), (_, two) = observed(3, case), observed(3, case)
        np.testing.assert_array_equal(one.ends, two.ends)
        assert len(one) == len(scene.true_ends)


def test_an_outcome_has_three_answers_and_a_row() -> None:
    found = outcome(CASES[0], 0)
    assert found is not None and len(found) == 5 and found[3] < 0.5
    table = markdown({case: [found, None] for case in CASES})
    assert table.count("\n") == 4 + len(CASES) and f"| {CASES[0].name} | 1 |" in table
