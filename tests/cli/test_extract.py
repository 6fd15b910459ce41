"""``blur2view triage --extract``: photographs and frames of videos as files, of one choice."""

from pathlib import Path

import cv2
import numpy as np

from blur2view.images.video import read_frame
from tests.support.calls import Call, table
from tests.support.many_photographs import contents, write_frames


def write_clip(path: Path, count: int) -> Path:
    """Return a video of one scene, the camera moved a little from frame to frame."""
    rng = np.random.default_rng(0)
    scene = cv2.resize(rng.integers(0, 255, (12, 24, 3), dtype=np.uint8), None, fx=10, fy=10)
    return write_frames(path, [scene[:96, index : index + 160] for index in range(count)])


def test_frames_of_a_video_are_extracted_under_their_numbers_and_classified_alike(
    call: Call, tmp_path: Path
) -> None:
    clip, folder = write_clip(tmp_path / "clip.mp4", 7), tmp_path / "clip"
    whole = ("--best", 100, "--extract", folder, "--csv", tmp_path / "video.csv")
    done = call("triage", clip, *whole)
    assert sorted(path.name for path in folder.iterdir()) == [f"frame_{k:05d}.png" for k in range(7)]
    assert done == 0 and f"7 kept; wrote {tmp_path / 'video.csv'} and {folder}" in done.out
    for number in range(7):  # the pixels themselves
        np.testing.assert_array_equal(
            cv2.imread(str(folder / f"frame_{number:05d}.png")), read_frame(clip, number)
        )
    assert call("triage", folder, "--csv", tmp_path / "frames.csv") == 0
    video, frames = table(tmp_path / "video.csv"), table(tmp_path / "frames.csv")
    place = dict.fromkeys(("name", "frame", "timestamp_s", "input_sha256", "options_sha256"), "")
    assert [one | place for one in video] == [one | place for one in frames]


def test_extracted_are_the_best_of_every_few_and_nothing_is_replaced(call: Call, tmp_path: Path) -> None:
    clip, folder, keep = write_clip(tmp_path / "clip.mp4", 8), tmp_path / "deep" / "kept", tmp_path / "k.txt"
    words = (clip, "--every-best", 4, "--extract", folder)
    assert call("triage", *words, "--keep", keep) == 0
    names = sorted(path.name for path in folder.iterdir())
    assert keep.read_text().splitlines() == [f"clip.mp4/0{name[6:11]}" for name in names]
    first, second = (int(name[6:11]) for name in names)
    assert 0 <= first < 4 <= second < 8
    before = contents(folder)
    done = call("triage", *words)
    assert done.line == f"blur2view: {folder}: holds {names[0]}; name an empty folder with --extract"
    assert contents(folder) == before
