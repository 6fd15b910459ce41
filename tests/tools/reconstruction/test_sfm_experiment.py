"""The experiment's figures on models that are exact, reversed or missing; the recordings' true motion."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from blur2view.errors import Blur2ViewError
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.geometry.rotation import rotation_matrix
from tools.reconstruction.alignment import Motion
from tools.reconstruction.recording import Recording, motion_per_frame, redkitchen_recording
from tools.reconstruction.sfm_report import Model, Result, markdown, read_model

COUNT, SHARE = 8, 0.5


def pose_at(time: float) -> np.ndarray:
    """cam_from_world of a camera that walks and rotates steadily."""
    R = rotation_matrix(np.array([0.02, 0.05, -0.01]) * time)
    return np.column_stack([R, -R @ (np.array([0.1, 0.03 * time / COUNT, 0.02]) * time)])


def recording(known: bool = True) -> Recording:
    poses = np.stack([pose_at(k) for k in range(COUNT)])
    first, last = (np.stack([pose_at(k + s * SHARE / 2) for k in range(COUNT)]) for s in (-1, 1))
    motion = Motion.between(first, last) if known else motion_per_frame(poses)
    paths = [Path(f"{k}.png") for k in range(COUNT)]
    return Recording(name="walk", paths=paths, K=np.eye(3), poses=poses, motion=motion, exposure_known=known)


def in_another_frame(pose: np.ndarray) -> np.ndarray:
    """Give the pose in a model's own frame and scale."""
    S, shift, scale = rotation_matrix(np.array([0.3, -1.0, 0.5])), np.array([1.0, 2, 3]), 4.0
    return np.column_stack([pose[:, :3] @ S, (pose[:, 3] + pose[:, :3] @ shift) / scale])


def model(reverse: bool = False) -> Model:
    poses = {f"{k}.png": in_another_frame(pose_at(k)) for k in range(COUNT)}
    ends = (CLOSE, OPEN) if reverse else (OPEN, CLOSE)
    for k in range(COUNT - 1):  # the last frame's views are missing
        for end, sign in zip(ends, (-1, 1), strict=True):
            poses[f"{k}.png{end}"] = in_another_frame(pose_at(k + sign * SHARE / 2))
    return Model(poses=poses, points=7, error_px=0.5)


def result(known: bool = True, reverse: bool = False) -> Result:
    truth, joined = recording(known), model(reverse)
    return Result(
        recording=truth,
        models={"without views": model(), "views placed": joined, "views mapped": joined},
        estimated=truth.motion.scaled(1.1, 1.0),
        time_known=COUNT,
        model_id="net",
    )


def mapped(found: Result) -> Motion:
    return found.motion_of(found.models["views mapped"])


def test_exact_model_has_no_error_in_any_frame_and_scale() -> None:
    found = result()
    errors = found.errors(mapped(found))
    assert np.nanmax(errors.rotation) < 1e-6 and np.nanmax(errors.translation) < 1e-6
    np.testing.assert_array_equal(np.isnan(errors.rotation), [False] * (COUNT - 1) + [True])
    assert found.alignment_of(found.models["views mapped"]).scale == pytest.approx(4)
    assert found.exposure(mapped(found)) == pytest.approx(1)
    assert np.nanmean(errors.forward) == 1


def test_reversed_views_are_told() -> None:
    found = result(reverse=True)
    errors = found.errors(mapped(found))
    assert np.nanmean(errors.forward) == 0 and np.nanmin(errors.rotation) > 1.9


def test_unknown_exposure_is_found_from_the_rotations() -> None:
    found = result(known=False)
    assert found.exposure(mapped(found)) == pytest.approx(SHARE, rel=1e-3)
    errors = found.errors(mapped(found))
    assert found.exposure(found.estimated) == pytest.approx(1.1)  # of the whole interval, as made above
    assert np.nanmedian(errors.rotation) < 0.01 and np.nanmedian(errors.translation) < 0.05


def test_tables_say_it_of_missing_models_too() -> None:
    text, found = markdown(result()), result()
    assert text.count("| 8 | 14 | 7 | 0.500 | 0.000 | 0.00% |") == 3
    assert "| views mapped | 7 | 0.0% | 100% |" in text
    assert "| single photographs | 8 | 10.0% | 100% |" in text
    text = markdown(replace(found, models=dict.fromkeys(found.models, read_model(None))))
    assert "| views placed | 0 | 0 | 0 | - |" in text and "| views placed | 0 | - |" in text


def test_motion_per_frame_is_that_of_the_neighbours() -> None:
    motion = motion_per_frame(np.stack([pose_at(k) for k in range(COUNT)]))
    exact = Motion.between(
        np.stack([pose_at(k - 0.5) for k in range(COUNT)]), np.stack([pose_at(k + 0.5) for k in range(COUNT)])
    )
    np.testing.assert_allclose(motion.rotations, exact.rotations, atol=1e-3)
    np.testing.assert_allclose(motion.translations[1:-1], exact.translations[1:-1], atol=5e-3)
    with pytest.raises(Blur2ViewError, match=r"poses\.npz"):
        redkitchen_recording(Path("/nowhere"))
