"""Which frames are looked at closely where one of some neighbours is chosen."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from blur2view.arrays import AnyArray
from blur2view.cli import choosing, triage
from blur2view.cli.batch import photograph
from blur2view.cli.batch.job import Job
from blur2view.cli.choosing import NEIGHBOURS, Candidates, sharpness_rank
from blur2view.images.inputs import Source
from blur2view.images.pixels import gradient_energy
from blur2view.images.video import EndOfVideo, frame_numbers, frame_time, frame_times
from blur2view.pipeline import estimate
from blur2view.records.record import Record
from tests.support.calls import Call, call_program
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


def test_gradient_energy_is_that_of_roofs_and_falls_with_blur_in_any_direction() -> None:
    roofs = 3 * np.abs(np.arange(160, dtype=np.uint8) % 40 - 20.0)[None].repeat(160, 0)  # of slope 3
    assert gradient_energy((roofs + roofs.T).astype(np.uint8)) == pytest.approx(9, rel=0.1)
    assert gradient_energy(roofs.astype(np.uint8)) == 0  # nothing tells of blur along the other direction
    energies = [gradient_energy(texture(blur)) for blur in (0.5, 1, 2, 4)]
    assert energies == sorted(energies, reverse=True)
    stripes = cv2.addWeighted(texture(1), 0.3, texture(1)[:1].repeat(96, 0), 0.7, 0)
    assert gradient_energy(cv2.blur(stripes, (1, 9))) < 0.6 * gradient_energy(stripes)  # along them


def test_candidates_are_the_quarter_with_most_gradients_two_at_least_read_once_and_in_order(
    tmp_path: Path,
) -> None:
    clip = write_blurred(tmp_path / "a.mp4", [5, 1, 5, 5, 0.5, 5])
    found = list(Candidates([jobs_of(clip, 6)]))
    assert [job.source.frame for job in found] == [1, 4]
    np.testing.assert_array_equal(found[1].content, Source(path=clip, frame=4).read())
    assert found[1].source.time_s == pytest.approx(0.4)


def test_a_long_group_is_compared_in_runs_of_neighbours(tmp_path: Path) -> None:
    blurs = [1.0 + 0.1 * k for k in range(2 * NEIGHBOURS)]  # all of the sharpest come first
    frames = [job.source.frame for job in Candidates([jobs_of(write_blurred(tmp_path / "a.mp4", blurs), 24)])]
    assert frames == [0, 1, 2, 12, 13, 14]


def test_what_cannot_be_read_is_a_candidate_and_fails_where_it_is_read(tmp_path: Path) -> None:
    (tmp_path / "damaged.png").write_bytes(b"none")
    damaged, missing = (Job(source=Source(path=tmp_path / name)) for name in ("damaged.png", "missing.png"))
    assert [job.source for job in Candidates([[damaged, missing]])] == [damaged.source, missing.source]


def test_what_opencv_does_not_decode_is_compared_as_well(tmp_path: Path) -> None:
    jobs = [Job(source=Source(path=tmp_path / f"{k}.tga")) for k in range(4)]
    for job, blur in zip(jobs, [5, 0.5, 5, 1], strict=True):
        Image.fromarray(texture(blur)).save(job.source.path)
    found = list(Candidates([jobs]))
    assert [job.source for job in found] == [jobs[1].source, jobs[3].source]
    assert found[0].plan == pytest.approx(gradient_energy(texture(0.5)), rel=0.02)


@pytest.mark.parametrize("scale", [0.4, 1, 4, 257])
def test_files_of_16_bits_are_compared_also_where_their_values_have_8_or_10(
    tmp_path: Path, scale: float
) -> None:
    jobs = [Job(source=Source(path=tmp_path / f"{k}.png")) for k in range(4)]
    for job, blur in zip(jobs, [5, 5, 0.5, 1], strict=True):
        cv2.imwrite(str(job.source.path), (texture(blur) * float(scale)).astype(np.uint16))
    assert [job.source for job in Candidates([jobs])] == [jobs[2].source, jobs[3].source]


def test_among_neighbours_the_width_of_blur_over_gradient_energy_decides() -> None:
    sharp, blurred = (
        Record(name="", use=use, smear_px=width) for use, width in (("sharp", 2.0), ("blurred", 9.0))
    )
    assert sharpness_rank(sharp, 1.0) < sharpness_rank(blurred, 100.0)  # those called sharp come first
    assert sharpness_rank(replace(blurred, smear_px=11.0), 3.0) < sharpness_rank(blurred, 2.0)
    assert sharpness_rank(replace(blurred, smear_px=11.0)) > sharpness_rank(blurred)
    assert sharpness_rank(replace(blurred, smear_px=0.1), 2.0) == sharpness_rank(
        replace(blurred, smear_px=0.9), 2.0
    )
    assert sharpness_rank(replace(blurred, smear_px=None), 2.0) > sharpness_rank(blurred, 0.0)


def test_a_table_has_every_frame_and_without_one_two_of_six_are_looked_at(call: Call, tmp_path: Path) -> None:
    clip = write_blurred(tmp_path / "a.mp4", [5, 1, 5, 5, 0.5, 5])
    words = ("triage", clip, "--every-best", 6, "--keep")
    assert "2 frames: " in (done := call(*words, tmp_path / "k.txt")).out and "1 kept of 6" in done.out
    assert "6 frames: " in call(*words, tmp_path / "l.txt", "--csv", tmp_path / "t.csv").out


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


def test_a_video_that_cannot_be_opened_is_named_as_such(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "cut.mp4").write_bytes(b"\0\0\0\x20ftypisom")
    words = ["triage", tmp_path / "cut.mp4", "--every-best", "0.5s", "--keep", tmp_path / "k.txt"]
    done = call_program(capsys, *words)
    assert done == 1 and "cannot be opened as a video" in done.err


def test_frames_of_a_varying_rate_are_grouped_by_their_own_times(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip, keep = write_blurred(tmp_path / "a.mp4", [1] * 10), tmp_path / "keep.txt"
    monkeypatch.setattr(
        triage, "frame_times", lambda video: [0, 0.1, 0.2, 0.3, 0.4, 0.4995, 0.9, 2, 2.1, 2.2]
    )
    assert call("triage", clip, "--every-best", "0.5s", "--keep", keep) == 0
    kept = [int(line[-6:]) for line in keep.read_text().splitlines()]
    assert kept[0] < 5 <= kept[1] < 7 <= kept[2]


def test_times_of_frames_are_those_of_decoding_them(tmp_path: Path) -> None:
    clip = write_blurred(tmp_path / "a.mp4", [1] * 10)
    assert frame_times(clip) == pytest.approx([frame_time(clip, k) for k in range(10)])


def test_frames_that_a_video_only_announces_are_not_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read(source: Source) -> AnyArray:
        if source.frame is None or source.frame > 3:
            raise EndOfVideo("ends after 4 of 6 frames")
        return texture(1)

    monkeypatch.setattr(Source, "read", read)
    monkeypatch.setattr(choosing, "frame_time", lambda *_: 0.0)
    jobs = jobs_of(tmp_path / "a.mp4", 6)
    compared = Candidates([jobs[:2], jobs[2:]])
    assert [job.source.frame for job in compared] == [0, 1, 2, 3, 4, 5] and compared.there == 4


def test_a_candidate_is_looked_at_once_and_a_photograph_of_a_table_as_closely_as_it_needs(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    closer, estimated = list[bool](), estimate

    def noted(*words: Any, **options: Any) -> Any:
        closer.append(options["closer"])
        return estimated(*words, **options)

    monkeypatch.setattr(photograph, "estimate", noted)
    clip = write_blurred(tmp_path / "a.mp4", [5, 1, 5, 5, 0.5, 5])
    assert call("triage", clip, "--every-best", 6, "--keep", tmp_path / "k.txt", "--jobs", 1) == 0
    assert call("triage", clip, "--jobs", 1) == 0
    assert closer == [False] * 2 + [True] * 6


def test_the_best_photographs_are_the_least_blurred_not_those_of_most_contrast(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "photos").mkdir()
    for name, blur_px, contrast in (("bold", 6.0, 1.0), ("pale", 3.0, 0.25)):
        picture = 128 + contrast * 6 * (texture(blur_px, (640, 480)).astype(float) - 128)
        Image.fromarray(picture.clip(0, 255).astype(np.uint8)).save(tmp_path / "photos" / f"{name}.png")
    kept = tmp_path / "kept.txt"
    words = ["triage", tmp_path / "photos", "--best", "1", "--keep", kept, "--jobs", "1"]
    assert call_program(capsys, *words) == 0
    assert kept.read_text() == "pale.png\n"


def test_parts_of_a_video_are_equal_in_the_frames_that_it_has(call: Call, tmp_path: Path) -> None:
    clip, keep = write_blurred(tmp_path / "a.avi", [1] * 5), tmp_path / "keep.txt"
    content = bytearray(clip.read_bytes())
    content[content.index(b"strh") + 40] = 9  # of frames that the header announces
    clip.write_bytes(content)
    assert len(frame_numbers(clip)) == 9 and len(frame_times(clip)) == 5
    assert call("triage", clip, "--best", 3, "--keep", keep) == 0
    assert len(keep.read_text().splitlines()) == 3
