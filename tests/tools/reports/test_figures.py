"""Figures: files stay small, cases are chosen by rank, curves and lines are those of the F they name."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from blur2view.smears.sampling import select_matches

from blur2view.geometry.epipolar import homogeneous
from blur2view.geometry.sampson import sampson, serrmin
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.networks.smear_network import SmearNetwork
from blur2view.segmentation.mask import MotionMask
from blur2view.smears.field import SmearField
from blur2view.two_view.estimate import estimate_two_view
from tools.datasets import testset
from tools.datasets.testset import TestScene, read_test_set
from tools.evaluation.evaluate import true_ends
from tools.rendering.failure_scenes import CARDS, KINDS, covered, failure_scene
from tools.reports import figure_style, figures
from tools.reports.figure_cases import Case, at_pixels, at_quantiles
from tools.reports.figure_curves import SERRMIN_PX2, image_curves, mean_curve
from tools.reports.figure_failures import caption, failure_figure
from tools.reports.figure_panels import draw_line, in_true_time
from tools.reports.figure_segmentation import mask_iou, painted, segmentation_panels

SIZE = (160, 128)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a test split of one small scene whose camera translates."""
    out = tmp_path_factory.mktemp("split")
    testset.write_scene(4, out, testset.test_options(None, SIZE))
    return out


@pytest.fixture(scope="module")
def scene(folder: Path) -> TestScene:
    return next(read_test_set(folder))


@pytest.fixture(scope="module")
def case(scene: TestScene) -> Case:
    """Give the scene with its true smears as if they were predicted, sigma growing to the right."""
    displacement = scene.displacement.repeat(4, 0).repeat(4, 1)
    sigma = np.broadcast_to(np.linspace(0.5, 1.5, SIZE[0]), SIZE[::-1]).astype(np.float32)
    field = SmearField(displacement=displacement, sigma_px=sigma)
    matches = select_matches(field)
    geometry = estimate_two_view(matches, rng=np.random.default_rng(0))
    assert geometry.F is not None
    return Case(scene=scene, field=field, matches=matches, geometry=geometry)


def without_F(case: Case) -> Case:
    found: TwoViewGeometry = replace(case.geometry, F=None)
    return replace(case, geometry=found)


def test_perfect_smears_have_no_error_and_a_missing_F_no_finite_one(case: Case) -> None:
    assert case.relative_error == 0 and case.rho < 0.05
    assert without_F(case).rho == np.inf
    assert 0.4 < case.sure.mean() < 0.6 and case.sure[:, 0].all() and not case.sure[:, -1].any()


def test_cases_are_chosen_by_rank_among_those_that_have_a_measure(case: Case) -> None:
    many = [replace(case, scene=replace(case.scene, name=str(k))) for k in range(12)]

    def measure(one: Case) -> float:
        return np.inf if one.scene.name == "7" else -float(one.scene.name)

    names = [one.scene.name for one in at_quantiles(many, measure, (0.0, 0.5, 1.0))]
    assert names == ["11", "5", "0"]
    with pytest.raises(ValueError, match="finite"):
        at_quantiles(many, lambda one: np.inf, (0.5,))


def test_cells_become_squares_of_pixels() -> None:
    large = at_pixels(np.array([[0, 1], [1, 0]]), (8, 8))
    np.testing.assert_array_equal(large, np.kron([[0, 1], [1, 0]], np.ones((4, 4))))


def test_sparsification_by_the_error_is_the_lowest(case: Case) -> None:
    wrong = replace(case.field, displacement=case.field.displacement * case.field.sigma_px[..., None])
    removed, by_coherence, by_sigma, by_error = image_curves(replace(case, field=wrong))
    assert [removed[0], by_coherence[0], by_sigma[0], by_error[0]] == pytest.approx([0, 1, 1, 1])
    assert (by_error <= by_sigma + 1e-9).all() and (by_error <= by_coherence + 1e-9).all()


def test_curve_is_the_share_below_each_bound_and_no_F_explains_nothing(case: Case) -> None:
    F, ends = case.scene.F, true_ends(case.scene)
    assert F is not None
    curve = mean_curve([F], [ends])
    assert curve[60] == pytest.approx((serrmin(F, ends) <= SERRMIN_PX2[60]).mean()) and curve[-1] == 1
    np.testing.assert_allclose(mean_curve([F, None], [ends, ends]), curve / 2)


def test_F_is_turned_to_the_true_direction_of_time(case: Case) -> None:
    F, ends = case.scene.F, true_ends(case.scene)
    assert F is not None
    for given in (F, F.T):
        np.testing.assert_array_equal(in_true_time(given, ends), F)
    assert np.median(sampson(F, ends[:, 0], ends[:, 1])) < np.median(sampson(F.T, ends[:, 0], ends[:, 1]))


def test_line_that_is_drawn_is_the_one_that_is_meant(case: Case) -> None:
    axes = figure_style.new_figure(2, 2).subplots()
    axes.set(xlim=(0, 100), ylim=(100, 0))
    for line in (np.array([3.0, 4.0, -250.0]), np.array([1.0, 0.0, -30.0])):  # slanted; upright
        draw_line(axes, line, color="k")
        drawn: Any = axes.lines[-1]
        points = np.array([drawn.get_xy1(), drawn.get_xy2()])
        np.testing.assert_allclose(homogeneous(points) @ line, 0, atol=1e-9)
        assert np.linalg.norm(points[1] - points[0]) == pytest.approx(1)
    draw_line(axes, np.array([0.0, 0.0, 1.0]), color="k")  # the line at infinity crosses no picture
    assert len(axes.lines) == 2


@pytest.mark.slow
def test_files_are_small_and_the_same_each_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figure = figure_style.new_figure(6, 4)
    noise = np.random.default_rng(0).random((400, 600, 3))
    figure_style.show_picture(figure.subplots(), noise)
    monkeypatch.setattr(figure_style, "MAX_BYTES", 120_000)
    paths = [figure_style.save(figure, tmp_path / name / "a.png") for name in "ab"]
    assert paths[0].read_bytes() == paths[1].read_bytes() and paths[0].stat().st_size <= 120_000
    monkeypatch.setattr(figure_style, "MAX_BYTES", 1000)
    with pytest.raises(ValueError, match="draw less"):
        figure_style.save(figure, tmp_path / "never.png")
    assert not (tmp_path / "never.png").exists()


def test_pictures_are_small_and_the_same_each_time(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (60, 80, 3), np.uint8)
    for name in "ab":
        figure_style.save_picture(cv2.blur(noise, (9, 9)).astype(np.uint8), tmp_path / name / "a.webp")
    first, second = ((tmp_path / name / "a.webp").read_bytes() for name in "ab")
    assert first == second and len(first) < noise.nbytes // 10
    with pytest.raises(ValueError, match="webp"):
        figure_style.save_picture(noise, tmp_path / "a.png")


def test_masks_are_judged_where_both_are_known(case: Case) -> None:
    static = np.ones_like(case.scene.static)
    static[8:16, 8:20] = False
    shown = replace(case, scene=replace(case.scene, static=static, valid=np.ones_like(static)))
    labels = np.where(at_pixels(~static, SIZE[::-1]) > 0.5, 1, 0).astype(np.uint8)
    plain = np.zeros(SIZE[::-1], np.float32)
    mask = MotionMask(labels=labels, probability=plain, score=plain, regions=(), reason="")
    assert mask_iou(shown, mask) == 1
    labels[:, 4 * 16 : 4 * 20] = 2  # a third of it is unobservable
    assert mask_iou(shown, mask) == 1
    labels[:, : 4 * 14] = 0  # of the rest, 2 of 8 columns are found
    assert mask_iou(shown, mask) == pytest.approx(2 / 8)
    moving, unseen = labels == 1, labels == 2
    picture = painted(np.ones((*SIZE[::-1], 3)), moving, unseen)
    assert np.ptp(picture[moving], axis=1).min() > 0.2 and np.ptp(picture[~moving], axis=1).max() < 1e-9
    assert picture[unseen].max() < 0.4 < picture[~unseen & ~moving].min()


def test_without_movers_the_picture_of_masks_is_left_out(
    case: Case,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tiny_model: Path,
) -> None:
    calm = replace(case, scene=replace(case.scene, static=np.ones_like(case.scene.static)))
    assert segmentation_panels([calm]) is None
    monkeypatch.setattr(figures, "cases", lambda scenes, network: [calm])
    figures.write(tmp_path, tmp_path, SmearNetwork(tiny_model), None, "segmentation")
    assert capsys.readouterr().out == "no scene for segmentation\n" and not list(tmp_path.iterdir())


@pytest.mark.slow
def test_every_figure_is_drawn(case: Case, tmp_path: Path) -> None:
    static = case.scene.static.copy()
    static[8:20, 8:20] = False
    case = replace(case, scene=replace(case.scene, static=static))
    with figure_style.style():
        for name, draw in figures.OF_CASES.items():
            figure = draw([case, without_F(case)])
            assert figure is not None
            path = figure_style.save(figure, tmp_path / f"{name}.png")
            picture = cv2.imread(str(path))
            assert picture is not None and picture.std() > 10 and min(picture.shape[:2]) > 200


def test_command_writes_the_figure_that_is_asked_for(
    folder: Path, tiny_model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = f"figures {folder} --out {tmp_path}/figures --model {tiny_model} --only sparsification"
    monkeypatch.setattr("sys.argv", words.split())
    figures.main()
    assert [path.name for path in (tmp_path / "figures").iterdir()] == ["sparsification.png"]
    monkeypatch.setattr("sys.argv", [*words.replace(str(folder), str(tmp_path)).split()])
    with pytest.raises(SystemExit, match="no scenes"):
        figures.main()


@pytest.mark.slow
def test_failures_are_what_they_are_called(tiny_model: Path) -> None:
    scenes = {kind: failure_scene(kind, 0, size=(96, 72)) for kind in KINDS}
    movers, plane, rotation = scenes.values()
    assert not movers.rendering.static.all() and plane.rendering.static.all()
    assert rotation.rendering.F is None and plane.rendering.F is not None
    truth = plane.rendering
    points = np.stack(np.meshgrid(np.arange(24) * 4 + 1.5, np.arange(18) * 4 + 1.5), -1) + truth.middle_offset
    first, last = ((points + k * truth.displacement / 2)[truth.valid].astype(np.float64) for k in (-1, 1))
    H, _ = cv2.findHomography(first, last)
    assert np.abs(cv2.perspectiveTransform(first[None], H)[0] - last).max() < 0.01
    with figure_style.style():
        figure = failure_figure([plane], SmearNetwork(tiny_model))
    assert figure.axes[0].get_title() == caption(plane) and "dominant plane, seed 0" in caption(plane)
    assert "moves by itself" in caption(movers)


def test_cards_are_those_that_cover_most() -> None:
    assert covered((-10, -10, 30, 20), (100, 80)) == 20 * 10
    assert covered((110, 0, 20, 20), (100, 80)) == 0
    assert covered((50, 50, 100, 100), (100, 80)) == 50 * 30
    assert CARDS == 6
