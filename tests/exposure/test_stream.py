"""A stream of frames: times of each, no lag where the order in time is not asked for, a gyroscope's sign."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from blur2view import Camera, SmearNetwork, estimate_frames
from blur2view.arrays import AnyArray
from blur2view.images.inputs import timestamp_of
from tests.support.colour_code import colour_code, forward_motion

PICTURE = colour_code(forward_motion(), 1.0)
HEIGHT, WIDTH = PICTURE.shape[:2]


def test_each_estimate_comes_with_its_time_when_the_next_frame_is_there(tiny_model: Path) -> None:
    asked: list[int] = []

    def frames() -> Iterator[AnyArray]:
        for number in range(3):
            asked.append(number)
            yield PICTURE

    network, camera = SmearNetwork(tiny_model), Camera.from_focal(300.0, (WIDTH, HEIGHT))
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
