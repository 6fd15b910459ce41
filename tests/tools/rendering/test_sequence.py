"""Rendered videos against their own truth: poses, smears, and what is seen from frame to frame."""

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from blur2view.errors import Blur2ViewError
from blur2view.geometry.epipolar import fundamental_from_pose
from blur2view.geometry.sampson import sampson
from tools.rendering.exposure import KNOTS, grid_points
from tools.rendering.render import compose
from tools.rendering.sequence import (
    SequenceOptions,
    Video,
    instants,
    paint_video,
    read_sequence,
    relative_pose,
    render_sequence,
)

OPTIONS = SequenceOptions(frames=4, size=(160, 128), smear_px=4.0, cards=4, exposure_share=0.5, detail=1.0)
MIDDLE = len(KNOTS) // 2


@cache
def video() -> Video:
    return paint_video(3, OPTIONS)


def test_path_is_the_identity_at_time_zero_and_never_stops() -> None:
    camera = video().exposure.camera
    R, centre = camera.at(0.0)
    np.testing.assert_allclose(R, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(centre, 0, atol=1e-12)
    places = np.array([camera.at(t)[1] for t in np.linspace(-8, 8, 65)])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps.min() > 0.2 * np.median(steps)


def test_smears_are_those_of_the_poses() -> None:
    times = instants(OPTIONS)
    poses = video().poses(times)
    for middle, (first, _, last) in zip(times, poses, strict=True):
        d = video().displacement(middle, video().fields(middle)).reshape(-1, 2).astype(float)
        points = grid_points(OPTIONS.size).reshape(-1, 2)
        relative = relative_pose(first, last)
        F = fundamental_from_pose(video().exposure.K, relative[:, :3], relative[:, 3])
        error = np.sqrt(sampson(F, points - d / 2, points + d / 2))
        assert np.median(error) < 0.06  # the bend of a smear
        assert np.median(np.sqrt(sampson(F.T, points - d / 2, points + d / 2))) > 4 * np.median(error)
    assert 2.5 < np.median(np.linalg.norm(d, axis=1)) < 8


def test_two_frames_show_the_same_surface_where_geometry_says() -> None:
    exposure, canvases = video().exposure, video().canvases
    first, second = instants(OPTIONS)[[0, 3]]
    fields = {t: [f[MIDDLE] for f in video().fields(t)] for t in (first, second)}
    pictures = {t: compose(canvases, fields[t], OPTIONS.size) for t in (first, second)}
    points, background = grid_points(OPTIONS.size), canvases[0]
    origin = points + fields[first][0][1:-1, 1:-1]
    covered = [c.warp((points + f[1:-1, 1:-1]).astype(np.float32))[..., 3] > 0 for c, f in
               zip(canvases[1:], fields[first][1:], strict=True)]  # fmt: skip
    there = exposure.moved(origin, background.layer, second).astype(np.float32)
    inside = ((there > 2) & (there < np.array(OPTIONS.size) - 3)).all(-1) & ~np.any(covered, axis=0)
    assert np.median(np.linalg.norm(there - points, axis=-1)[inside]) > 8
    colours = [
        cv2.remap(pictures[t], at[..., 0].astype(np.float32), at[..., 1].astype(np.float32), cv2.INTER_LINEAR)
        for t, at in ((first, points), (second, there))
    ]
    assert inside.sum() > 100
    assert np.median(np.abs(colours[0] - colours[1]).mean(-1)[inside]) < 0.02


def test_written_video_is_read_back_and_repeats(tmp_path: Path) -> None:
    small = SequenceOptions(frames=2, size=(64, 48), smear_px=3.0, cards=1, detail=1.0)
    truth = render_sequence(1, tmp_path / "a", small)
    render_sequence(1, tmp_path / "b", small)
    paths, read = read_sequence(tmp_path / "a")
    assert [path.name for path in paths] == ["frame_000.png", "frame_001.png"]
    for path in paths:
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()
    np.testing.assert_array_equal(read.poses, truth.poses)
    assert read.relative.shape == (2, 3, 4) and read.smear_px.shape == (2,)
    with pytest.raises(Blur2ViewError, match="tools.rendering.sequence"):
        read_sequence(tmp_path)
