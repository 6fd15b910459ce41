"""Frames of a video: the order in time that neighbours show, also with a rolling shutter; times, no lag."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from blur2view.arrays import AnyArray, Array
from blur2view.camera import Camera
from blur2view.exposure.sequence import Matches, estimate_frames, in_time, picture_motion
from blur2view.geometry.pose import rotation_flow
from blur2view.geometry.rolling_shutter import RollingShutter
from blur2view.images.times import timestamp_of
from blur2view.images.video import read_frame, read_video
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import Estimate
from blur2view.smears.blur import Blur, BlurKind
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.estimate import estimate_two_view
from tests.exposure.test_time_direction import texture
from tests.support.colour_code import colour_code, forward_motion
from tests.support.grids import grid_of
from tests.support.many_photographs import write_video

SIZE = (640, 480)
CAMERA = Camera.from_focal(600.0, SIZE)
TURN: Array = np.array([-0.03, 0.02, 0.01])
ROLLING = RollingShutter(readout_s=0.02, exposure_s=0.02)


def estimate_of(shutter: RollingShutter | None) -> Estimate:
    """Return the estimate of smears of a turn, each row seen for longer if points move with the rows."""
    pixels = np.random.default_rng(0).uniform(0.05, 0.95, (300, 2)) * SIZE
    smears = np.tensordot(TURN, rotation_flow(CAMERA.rays(pixels)), (0, 1)).T * CAMERA.focal_px
    if shutter is not None:  # D = e v / (1 - r v_y), of velocity e v = smears
        smears /= 1 - shutter.readout_s / shutter.exposure_s * smears[:, 1:] / (SIZE[1] - 1)
    ends = np.stack([pixels - smears / 2, pixels + smears / 2], axis=1)
    ends[::2] = ends[::2, ::-1]
    matches = SmearMatches(ends=ends, sigma_px=np.full(len(ends), 0.3), image_size=SIZE)
    return Estimate(
        grid=grid_of(np.zeros((SIZE[1], SIZE[0], 2)), 1.0),
        blur=Blur(kind=BlurKind.CAMERA_MOVED),
        matches=matches,
        geometry=estimate_two_view(matches, camera=CAMERA, shutter=shutter),
        model_id="test",
        camera=CAMERA,
        shutter=shutter,
    )


def seen(sign: float) -> dict[int, Matches]:
    """Return matches with the next frame, of the turn or of its reverse."""
    pixels = np.random.default_rng(1).uniform(0.05, 0.95, (200, 2)) * SIZE
    flow = np.tensordot(sign * TURN, rotation_flow(CAMERA.rays(pixels)), (0, 1)).T * CAMERA.focal_px
    return {1: (pixels, pixels + 1.2 * flow)}


@pytest.mark.parametrize("shutter", [None, ROLLING], ids=["global", "rolling"])
def test_pose_and_every_smear_are_of_the_order_that_neighbours_show(shutter: RollingShutter | None) -> None:
    result = estimate_of(shutter)
    both = [in_time(result, seen(sign)) for sign in (1, -1)]
    for sign, one in zip((1, -1), both, strict=True):
        velocity = one.angular_velocity(1.0)
        assert velocity is not None and one.time.known
        assert velocity.mean @ TURN * sign > 0
        ends, swapped = one.matches.ends, one.geometry.second_end_is_open[:, None]
        moved = np.where(swapped, ends[:, 0] - ends[:, 1], ends[:, 1] - ends[:, 0])
        flow = np.tensordot(sign * TURN, rotation_flow(CAMERA.rays(ends.mean(axis=1))), (0, 1)).T
        assert ((moved * flow).sum(axis=1) > 0).mean() > 0.99
    right = both[0].angular_velocity(1.0)
    assert right is not None
    assert np.linalg.norm(right.mean - TURN) < 0.03 * np.linalg.norm(TURN)
    if shutter is not None:  # the reverse is another motion
        wrong = both[1].angular_velocity(1.0)
        assert wrong is not None and np.linalg.norm(wrong.mean + right.mean) > 0.02 * np.linalg.norm(TURN)


def test_a_video_is_read_in_order_and_what_is_none_is_refused_at_once(
    tmp_path: Path, tiny_model: Path
) -> None:
    video, network = write_video(tmp_path / "clip.avi", 5), SmearNetwork(tiny_model, threads=1)
    frames = list(read_video(video, every=2))
    assert len(frames) == 3
    for number, frame in zip((0, 2, 4), frames, strict=True):
        np.testing.assert_array_equal(frame[..., ::-1], read_frame(video, number) / np.float32(255))
    assert len(list(estimate_frames(video, network=network))) == 5
    for wrong in (frames[0], frames[0][..., 0], 3):
        with pytest.raises(ValueError, match=r"expected the frames of a video.*call estimate\(image\)"):
            estimate_frames(wrong, network=network)  # type: ignore[arg-type]
    series = estimate_frames([frames[0], frames[1][:48]], network=network)
    with pytest.raises(
        ValueError, match=r"frame 1 has \(80, 48\) pixels, but the frames before have \(80, 64\)"
    ):
        list(series)
    with pytest.raises(ValueError, match="fewer timestamps than frames"):
        list(estimate_frames(frames, timestamps_s=[0.0], network=network))


def test_both_neighbours_show_the_motion_of_a_frame_forwards(
    tiny_model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wall, shown = texture((400, 300)), list[Array]()

    def keep(one: Estimate, matches: dict[int, Matches]) -> Estimate:
        for steps, pair in matches.items():
            shown.append(np.array([steps, *np.median(picture_motion({steps: pair}).velocity, axis=0)]))
        return one

    monkeypatch.setattr("blur2view.exposure.sequence.in_time", keep)
    frames = [wall[5 * k : 5 * k + 240, 40 - 12 * k : 360 - 12 * k] for k in range(3)]
    assert len(list(estimate_frames(frames, network=SmearNetwork(tiny_model)))) == 3
    np.testing.assert_allclose(shown, [[k, 12, -5] for k in (1, -1, 1, -1)], atol=0.1)


def test_each_estimate_comes_with_its_time_when_the_next_frame_is_there(tiny_model: Path) -> None:
    asked: list[int] = []
    picture = colour_code(forward_motion(), 1.0)

    def frames() -> Iterator[AnyArray]:
        for number in range(3):
            asked.append(number)
            yield picture

    network, camera = SmearNetwork(tiny_model), Camera.from_focal(300.0, picture.shape[1::-1])
    found = estimate_frames(frames(), timestamps_s=iter([10.0, 10.5, 11.0]), network=network, camera=camera)
    assert next(found).timestamp_s == 10.0 and len(asked) == 2
    assert [one.timestamp_s for one in found] == [10.5, 11.0]


@pytest.mark.parametrize(
    ("name", "seconds"),
    [
        ("1305031102.175304.png", 1305031102.175304),
        ("1403636579763555584.png", 1403636579.763555584),
        ("1403636579.jpg", 1403636579.0),
        *((name, None) for name in ("000120.png", "frame_1403636579.png", "20240511.jpg", "a.b.png")),
    ],
)
def test_names_that_are_times_say_when(name: str, seconds: float | None) -> None:
    assert timestamp_of(name) == (None if seconds is None else pytest.approx(seconds, abs=1e-6))
