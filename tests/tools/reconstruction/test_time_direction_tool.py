"""The measure of the flip of time itself, and the flip of time on rendered and on recorded frames."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import blur2view
from blur2view.arrays import Array
from tests.support.scenes import some_views
from tools.reconstruction.sequence import SequenceOptions, render_sequence
from tools.reconstruction.time_direction import Directed, agreement, plot, redkitchen, rendered, report, row

RECORDED = Path(__file__).resolve().parents[4] / "shared" / "data" / "redkitchen_sequence"


def directed(rotation: Array, true_rotation: Array) -> Directed:
    return Directed(
        agreement=np.array([0.9, -0.2, 0.4]),
        confidence=np.array([0.99, 0.0, 0.9]),
        rotation=rotation,
        true_rotation=true_rotation,
    )


def test_rotations_are_compared_after_one_scale() -> None:
    true = np.array([[1.0, 0, 0], [0, 2.0, 0], [0, 0, 3.0]]) / 100
    found = directed(0.4 * true, true)
    assert found.scale == pytest.approx(0.4)
    np.testing.assert_allclose(found.rotation_error, 0, atol=1e-12)
    turned = 0.4 * true * [[1], [1], [-1]]
    worse = directed(turned, true)
    np.testing.assert_allclose(worse.rotation_error, [0, 0, 2], atol=1e-12)
    assert worse.same_sense.tolist() == [True, True, False]


def test_a_row_counts_frames() -> None:
    true = np.eye(3) / 100
    found = directed(true, true)
    cells = [cell.strip() for cell in row("clip", "known", found, found).split("|")]
    assert cells[1:8] == ["clip", "known", "3", "66.7", "66.7", "66.7", "100.0"]
    without = directed(np.full((3, 3), np.nan), true)
    assert row("clip", "unknown", without, without).endswith("| - | - | - |")


def test_agreement_is_the_mean_cosine_of_the_inliers() -> None:
    views = some_views(count=9)
    smear = views.points_close - views.points_open
    middle = (views.points_open + views.points_close) / 2

    def flow(points: Array) -> Array:
        index = [int(np.argmin(np.linalg.norm(middle - point, axis=1))) for point in points]
        return np.asarray(3 * smear[index])

    assert agreement(views, flow) == pytest.approx(1)
    assert agreement(views.reversed(), flow) == pytest.approx(-1)
    none = replace(views, geometry=replace(views.geometry, inlier_mask=np.zeros(9, bool)))
    assert agreement(none, flow) == 0


def test_recorded_poses_give_flow_and_rotation(tmp_path: Path) -> None:
    """A camera that turns by 0.01 about y: the picture moves left, by f times that at its centre."""
    turns = [np.asarray(cv2.Rodrigues(np.array([0, 0.01 * k, 0]))[0]) for k in range(4)]
    poses = np.array([np.column_stack([R, np.zeros(3)]) for R in turns])
    K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    np.savez(tmp_path / "poses.npz", cam_from_world=poses, K=K, frame=np.arange(4))
    video = redkitchen(tmp_path)
    assert list(video.judged) == [1, 2] and [path.name for path in video.paths][:1] == ["000000.jpg"]
    np.testing.assert_allclose(video.rotation[1], [0, 0.01, 0], atol=1e-9)
    centre = np.array([[319.5, 239.5]])
    np.testing.assert_allclose(video.flow(1, centre), [[500 * np.tan(0.02), 0]], atol=1e-6)


def test_plot_is_a_picture(tmp_path: Path) -> None:
    true = np.random.default_rng(0).normal(size=(3, 3)) / 100
    plot(tmp_path / "out.png", [("clip", directed(true, true))])
    picture = cv2.imread(str(tmp_path / "out.png"))
    assert picture is not None and picture.std() > 5


@pytest.mark.slow
def test_rendered_frames_are_put_right_by_their_neighbours(tmp_path: Path) -> None:
    options = SequenceOptions(frames=4, size=(320, 240), smear_px=9.0, cards=5, detail=1.0)
    truth = render_sequence(2, tmp_path, options)
    video = rendered(tmp_path)
    np.testing.assert_allclose(video.flow(1, np.array([[41.5, 21.5]])), [truth.displacement[1, 5, 10]])
    table, drawn = report([video], blur2view.SmearNetwork())
    assert table.count("\n") == 4
    (_, found), *_ = drawn
    known = found.confidence > 0  # one frame turns back, with smears of 3.6 px in a corner: no motion
    assert known.sum() >= 3 and (found.agreement[known] > 0).all()


@pytest.mark.slow
@pytest.mark.skipif(not RECORDED.exists(), reason="needs ../shared/data/redkitchen_sequence")
def test_recorded_frames_are_put_right_by_their_neighbours() -> None:
    whole, few = redkitchen(RECORDED), slice(4, 12)
    video = replace(
        whole,
        paths=whole.paths[few],
        rotation=whole.rotation[few],
        flow=lambda index, points: whole.flow(index + 4, points),
        judged=range(8),
    )
    _, drawn = report([video], blur2view.SmearNetwork())
    (_, found), *_ = drawn
    assert (found.agreement > 0).mean() >= 0.9
    assert found.same_sense.mean() >= 0.75
