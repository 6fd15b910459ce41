"""Which frames are looked at closely where one of some neighbours is chosen."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from blur2view.arrays import AnyArray
from blur2view.cli import run
from blur2view.cli.choosing import NEIGHBOURS, candidates
from blur2view.cli.jobs import Job
from blur2view.images.inputs import Source
from blur2view.images.pixels import gradient_energy
from blur2view.pipeline import estimate
from tests.support.calls import Call
from tests.support.many_photographs import contents, write_frames


def texture(blur_px: float, size: tuple[int, int] = (160, 96)) -> AnyArray:
    """Return noise (H, W, 3), uint8, blurred by a Gaussian."""
    noise = np.random.default_rng(0).integers(0, 255, (*size[::-1], 3), dtype=np.uint8)
    return np.asarray(cv2.GaussianBlur(noise, (0, 0), blur_px))


def write_blurred(path: Path, blurs_px: list[float]) -> Path:
    """Return a video of one texture, blurred in each frame by a Gaussian."""
    return write_frames(path, [texture(blur) for blur in blurs_px])


def jobs_of(clip: Path, count: int) -> list[Job]:
    """Return a job for each frame of a video."""
    return [Job(source=Source(path=clip, frame=k)) for k in range(count)]


def test_gradient_energy_is_that_of_a_ramp_and_falls_with_blur() -> None:
    ramp = np.tile(3 * np.arange(60, dtype=np.uint8), (40, 1))
    assert gradient_energy(ramp) == pytest.approx(9, rel=0.05)  # the border repeats its pixels
    energies = [gradient_energy(texture(blur)) for blur in (0.5, 1, 2, 4)]
    assert energies == sorted(energies, reverse=True)


def test_candidates_are_the_third_with_most_gradients_read_once_and_in_order(tmp_path: Path) -> None:
    clip = write_blurred(tmp_path / "a.mp4", [5, 1, 5, 5, 0.5, 5])
    found = list(candidates([jobs_of(clip, 6)]))
    assert [job.source.frame for job in found] == [1, 4]
    np.testing.assert_array_equal(found[1].content, Source(path=clip, frame=4).read())
    assert found[1].source.time_s == pytest.approx(0.4)


def test_a_long_group_is_compared_in_runs_of_neighbours(tmp_path: Path) -> None:
    blurs = [1.0 + 0.1 * k for k in range(2 * NEIGHBOURS)]  # all of the sharpest come first
    frames = [job.source.frame for job in candidates([jobs_of(write_blurred(tmp_path / "a.mp4", blurs), 24)])]
    assert frames == [0, 1, 2, 3, 12, 13, 14, 15]


def test_what_cannot_be_read_is_a_candidate_and_fails_where_it_is_read(tmp_path: Path) -> None:
    (tmp_path / "damaged.png").write_bytes(b"none")
    damaged, missing = (Job(source=Source(path=tmp_path / name)) for name in ("damaged.png", "missing.png"))
    assert [job.source for job in candidates([[damaged, missing]])] == [damaged.source, missing.source]


def test_a_table_has_every_frame_and_without_one_the_third_is_looked_at(call: Call, tmp_path: Path) -> None:
    clip = write_blurred(tmp_path / "a.mp4", [5, 1, 5, 5, 0.5, 5])
    words = ("triage", clip, "--every-best", 6, "--keep")
    assert "2 photographs: " in (done := call(*words, tmp_path / "k.txt")).out and "1 kept of 6" in done.out
    assert "6 photographs: " in call(*words, tmp_path / "l.txt", "--csv", tmp_path / "t.csv").out


def test_the_best_of_a_video_are_spread_over_it(call: Call, tmp_path: Path) -> None:
    clip, folder = write_blurred(tmp_path / "a.mp4", [0.5] * 4 + [3] * 4), tmp_path / "kept"
    assert call("triage", clip, "--best", 2, "--extract", folder) == 0
    first, second = (int(name[6:11]) for name in sorted(contents(folder)))
    assert first < 4 <= second


def test_seconds_are_those_of_the_video(call: Call, tmp_path: Path, still: Path) -> None:
    clip, keep = write_blurred(tmp_path / "a.mp4", [1] * 10), tmp_path / "keep.txt"  # ten a second
    assert call("triage", clip, "--every-best", "0.5s", "--keep", keep) == 0
    first, second = (int(line[-6:]) for line in keep.read_text().splitlines())
    assert first < 5 <= second
    assert "is not a frame of a video" in call("triage", still, "--every-best", "1s", "--keep", keep).line
    assert "expected a number as 10 or a duration as 0.5s" in call("triage", clip, "--every-best", "0s").line


def test_a_candidate_is_looked_at_once_and_a_photograph_of_a_table_as_closely_as_it_needs(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    closer, estimated = list[bool](), estimate

    def noted(*words: Any, **options: Any) -> Any:
        closer.append(options["closer"])
        return estimated(*words, **options)

    monkeypatch.setattr(run, "estimate", noted)
    clip = write_blurred(tmp_path / "a.mp4", [5, 1, 5, 5, 0.5, 5])
    assert call("triage", clip, "--every-best", 6, "--keep", tmp_path / "k.txt", "--jobs", 1) == 0
    assert call("triage", clip, "--jobs", 1) == 0
    assert closer == [False] * 2 + [True] * 6
