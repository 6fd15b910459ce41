"""Masks that the motion segmentation network decides: where it is asked, and what becomes of what it says."""

from dataclasses import replace

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray

from blur2view.pipeline import Estimate
from blur2view.segmentation.mask import MotionLabel, SegmentOptions, segment
from blur2view.segmentation.network import MotionNetwork
from blur2view.segmentation.regions import DENIED, HIGH_PROBABILITY, LOW_PROBABILITY, decide_by_network
from blur2view.segmentation.score import motion_score
from tests.segmentation.test_network import red_and_long
from tests.support.motion_scenes import (
    BOX,
    HEIGHT,
    SIDEWAYS,
    WIDTH,
    by_scores,
    estimate_of,
    photo,
    sideways,
    with_mover,
)


@pytest.fixture(scope="module")
def red(tmp_path_factory: pytest.TempPathFactory) -> MotionNetwork:
    """Give a network that calls red cells moving, orange ones too: 0.01 on the wall, 0.88 in the box."""
    path = tmp_path_factory.mktemp("model") / "red.onnx"
    model = red_and_long(bias=-18.0)  # smears are 12 to 18 px long: 1.7 to 2 of the logit
    red, told = (onnx.numpy_helper.to_array(part).copy() for part in model.graph.initializer[:2])
    red[:, 0], told[:] = 25.0, 0.0
    for part, value in zip(model.graph.initializer[:2], (red, told), strict=True):
        part.CopyFrom(onnx.numpy_helper.from_array(value, part.name))
    onnx.save(model, path)
    return MotionNetwork(path, threads=1)


def truth() -> NDArray[np.bool_]:
    true = np.zeros((HEIGHT, WIDTH), bool)
    true[BOX] = True
    return true


def test_network_decides_before_a_moving_camera(red: MotionNetwork) -> None:
    """The smears show no mover here: only the network can."""
    mask = segment(estimate_of(sideways(), F=SIDEWAYS), photo(), network=red)
    moving = mask.labels == MotionLabel.MOVING
    assert (moving & truth()).sum() / (moving | truth()).sum() > 0.9
    np.testing.assert_array_equal(mask.probability > 0.5, moving)
    assert mask.model_id == "red-and-long" and mask.reason.endswith(
        "decided by scores and the network red-and-long"
    )
    np.testing.assert_allclose(mask.evidence[120, 225], 1 / (1 + np.exp(18 - 25 * 0.8)), atol=0.05)
    assert mask.evidence[30, 30] < 0.02 and mask.score.max() < 1e-6


@pytest.mark.parametrize("case", ["still", "unknown", "scores", "no image"])
def test_network_is_not_asked_elsewhere(
    red: MotionNetwork, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("asked")

    monkeypatch.setattr(red, "probability", refuse)
    before_still = np.where(with_mover() == sideways(), 0, with_mover())
    found: Estimate = {
        "still": estimate_of(before_still),
        "unknown": estimate_of(sideways()),
    }.get(case, estimate_of(with_mover(), F=SIDEWAYS))
    image = None if case == "no image" else photo()
    mask = segment(found, image, SegmentOptions(learned=case != "scores"), network=red)
    alone = by_scores(found, image)
    np.testing.assert_array_equal(mask.labels, alone.labels)
    np.testing.assert_array_equal(mask.evidence, mask.score)
    assert mask.model_id == "" and "network" not in mask.reason


def test_shipped_network_is_the_default() -> None:
    found = estimate_of(sideways(), F=SIDEWAYS)
    mask = segment(found, photo())
    assert mask.model_id == MotionNetwork().info.model_id and mask.model_id.startswith("motion-")


def test_weak_parts_need_strong_ones_and_nothing_is_told_where_nothing_can_be_seen() -> None:
    found = estimate_of(sideways(), F=SIDEWAYS)
    reach = np.full((HEIGHT // 4, WIDTH // 4), 100.0)
    reach[:, 40:] = 0
    scored = replace(motion_score(found), reach=reach)
    chance = np.full((HEIGHT, WIDTH), 0.05, np.float32)
    chance[20:60, 20:60] = (LOW_PROBABILITY + HIGH_PROBABILITY) / 2  # weak alone
    chance[100:140, 20:60] = (LOW_PROBABILITY + HIGH_PROBABILITY) / 2
    chance[100:140, 60:100] = HIGH_PROBABILITY + 0.02
    chance[200:230, 200:300] = 0.95  # where smears alone cannot tell
    cells = decide_by_network(scored, photo(), chance)
    assert not cells.moving[20:60, 20:60].any()
    assert cells.moving[102:138, 22:98].all() and cells.moving[202:228, 202:298].all()
    assert cells.observable[:, :140].all() and not cells.observable[:60, 200:].any()
    assert (cells.probability[:60, 200:] == 0).all() and cells.probability[10, 10] < 0.1
    assert cells.probability[120, 40] < 0.5 < cells.probability[120, 80] < cells.probability[215, 250] <= 1


def test_parts_found_by_scores_move_unless_the_network_denies_it() -> None:
    found = estimate_of(with_mover(), F=SIDEWAYS)
    scored = motion_score(found)
    for chance, moves in ((DENIED + 0.05, True), (DENIED - 0.05, False)):
        cells = decide_by_network(scored, photo(), np.full((HEIGHT, WIDTH), chance, np.float32))
        assert cells.moving[85:155, 185:265].all() == moves == cells.moving.any()
    none = decide_by_network(
        motion_score(estimate_of(sideways(), F=SIDEWAYS)), photo(), np.full((HEIGHT, WIDTH), 0.3, np.float32)
    )
    assert not none.moving.any()


def test_certain_cells_warn_of_nothing() -> None:
    found = estimate_of(sideways(), F=SIDEWAYS)
    cells = decide_by_network(motion_score(found), photo(), np.ones((HEIGHT, WIDTH), np.float32))
    assert cells.moving.all() and (cells.probability > 0.99).all()
