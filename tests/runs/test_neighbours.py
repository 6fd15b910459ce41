"""Which photographs are neighbours in time."""

from collections.abc import Sequence
from pathlib import Path

from blur2view.photographs.video import frame_path
from blur2view.runs.job import neighbours_of


def _beside(paths: Sequence[Path], sequence: bool | None) -> list[list[tuple[int, Path]]]:
    """Return the steps to the neighbours of each photograph, and where they are."""
    return [[(one.steps, one.path) for one in found] for found in neighbours_of(paths, sequence).values()]


def test_neighbours_are_named_beside_a_photograph_and_lie_in_its_folder() -> None:
    first, second, elsewhere = paths = [Path("a/1.png"), Path("a/2.png"), Path("b/1.png")]
    assert _beside(paths, True) == [[(1, second)], [(-1, first)], []]
    assert _beside([elsewhere, first, second], True) == [[], [(1, second)], [(-1, first)]]
    assert _beside(paths, None) == [[], [], []]


def test_frames_have_neighbours_unless_they_are_refused(tmp_path: Path) -> None:
    video = tmp_path / "walk.mp4"
    video.touch()
    first, second, third = paths = [frame_path(video, index) for index in range(3)]
    assert _beside(paths[:2], None) == [[(1, second)], [(-1, first), (1, third)]]
    assert _beside(paths[:2], False) == [[], []]
