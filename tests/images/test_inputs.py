"""What a user names becomes photographs in order."""

import io
import os
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from blur2view.errors import ImageError
from blur2view.exposure.sequence import frame_names
from blur2view.images.inputs import Inputs, Source, list_photographs
from blur2view.images.video import frame_numbers
from blur2view.results.overlay import png
from tests.support.many_photographs import write_video


def listed(*words: object, **options: object) -> Inputs:
    """Return the photographs that words name."""
    return list_photographs([str(word) for word in words], **options)  # type: ignore[arg-type]


def paths(*words: object, **options: object) -> list[Path]:
    """Return their files."""
    return [one.path for one in listed(*words, **options).sources]


def refusals(found: Inputs) -> list[str]:
    """Return why some cannot be used."""
    return [one.refusal for one in found.sources if one.refusal]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of photographs, a text, a result, a subfolder, and what macOS puts there."""
    names = ("frame_10.jpg", "frame_2.JPG", "notes.txt", "sub/a.tif", "sub/deep/b.heic", "c.NEF", "._c.NEF")
    for name in names:
        path = tmp_path / "in" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"x")
    (tmp_path / "in/ours.png").write_bytes(png(np.zeros((4, 4), np.uint8)))
    return tmp_path / "in"


def test_folder_stands_for_its_photographs_in_the_order_of_their_numbers(folder: Path) -> None:
    found = listed(folder)
    assert [one.name for one in found.sources] == ["c.NEF", "frame_2.JPG", "frame_10.jpg"]
    assert not refusals(found) and found.names() == ["c.NEF", "frame_2.JPG", "frame_10.jpg"]
    (folder / "empty").mkdir()
    assert "holds no photograph or video; name another folder" in refusals(listed(folder / "empty"))[0]
    (folder.parent / "outer").mkdir()
    (folder.parent / "outer/in").symlink_to(folder)  # not followed, as with --recursive
    assert "name another folder" in refusals(listed(folder.parent / "outer"))[0]
    assert "add --recursive for its subfolders" in refusals(listed(folder.parent))[0]
    below = listed(folder, recursive=True)
    assert below.names() == [*found.names(), "sub/a.tif", "sub/deep/b.heic"]
    assert list(map(str, below.result_names()))[3:] == ["sub/a", "sub/deep/b"]


def test_folder_of_videos_and_animated_gif_stand_for_frames_and_what_is_passed_over_is_named(
    tmp_path: Path,
) -> None:
    pages = [Image.new("L", (40, 40), 50 * k) for k in range(3)]
    pages[0].save(tmp_path / "a.gif", save_all=True, append_images=pages[1:])
    clip = write_video(tmp_path / "clip.mp4", 5)
    frames = [Source(path=tmp_path / "a.gif", frame=k) for k in range(3)]
    assert listed(tmp_path).sources == frames + [Source(path=clip, frame=k) for k in range(5)]
    assert listed(tmp_path).names()[-1] == "clip.mp4/000004" and not listed(tmp_path).passed_over
    assert len(frames[1].read()) == 40 and listed(tmp_path / "a.gif/000002").sources == frames[2:]
    for name in ("still.gif", "b.ppm", "c.tga", "d.pgm"):
        pages[0].save(tmp_path / name)
    found = listed(tmp_path)
    assert [one.name for one in found.sources] == ["b.ppm", "c.tga", "d.pgm", "still.gif"]
    assert found.passed_over == [tmp_path / "a.gif", clip]


@pytest.mark.parametrize("name", ["@frames", "-"])
def test_folder_is_a_folder_whatever_it_is_called(here: Path, name: str) -> None:
    (here / name).mkdir()
    Image.new("L", (40, 40)).save(here / name / "a.png")
    assert frame_names(name) == ["a.png"]


def test_a_list_names_a_word_on_each_line_but_blank_ones_and_comments(folder: Path, here: Path) -> None:
    lines = ["# of the first day", f" {folder}/frame_10.jpg ", "", "./#c.jpg", "beside.jpg", f"{folder}/sub"]
    content = b"\xef\xbb\xbf" + "\r\n".join(lines).encode() + b"\nsec\xffond.jpg\n"
    Path("lists").mkdir()
    for name in ("list", "beside.jpg"):
        Path("lists", name).write_bytes(content)
    expected = [folder / "frame_10.jpg", Path("#c.jpg"), Path("beside.jpg"), folder / "sub/a.tif"]
    expected.append(Path(os.fsdecode(b"sec\xffond.jpg")))
    assert paths("first.jpg", "-", stdin=io.BytesIO(content)) == [Path("first.jpg"), *expected]
    expected[2] = Path("lists/beside.jpg")
    assert paths("@lists/list") == expected
    Path("list").write_bytes(b"\x89PNG\0")
    with pytest.raises(ImageError, match="name a photograph without @"):
        listed("@list")


def test_what_is_named_twice_is_there_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    found = listed("frame_10.jpg", folder, "sub/../frame_10.jpg", "sub", "sub", "absent.jpg", "./absent.jpg")
    names = [one.name for one in found.sources]
    assert names == ["frame_10.jpg", "c.NEF", "frame_2.JPG", "a.tif", "absent.jpg"]
    (folder / "empty").mkdir()
    assert len(paths("empty", "empty")) == 1
    (folder / "link").symlink_to(folder / "sub/deep")
    assert len(paths("x.jpg", "link/../x.jpg")) == 2  # the second is sub/x.jpg


def test_list_that_may_never_end_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for endless in ("/dev/zero", tmp_path / "pipe"):
        with pytest.raises(
            ImageError, match=r"cannot be read \(is not a regular file\).*pipe such a list to -"
        ):
            listed(f"@{endless}")


@pytest.mark.parametrize(
    ("options", "numbers"),
    [
        ({}, range(25)),
        ({"every": 4, "first": 3, "last": 12}, [3, 7, 11]),
        ({"first": 1.2, "last": 1.4}, [12, 13, 14]),
        ({"first": 2.4, "last": 1e308}, [24]),
    ],
)
def test_video_stands_for_its_frames_named_after_their_numbers(
    tmp_path: Path, options: dict[str, Any], numbers: list[int]
) -> None:
    video = write_video(tmp_path / "clip.mp4", 25)
    found = listed(video, frames=partial(frame_numbers, **options))
    assert found.sources == [Source(path=video, frame=number) for number in numbers]
    assert found.names() == [f"clip.mp4/{number:06d}" for number in numbers]
    assert found.result_names() == [Path("clip", f"{number:06d}") for number in numbers]
    assert found.one_video and listed(video / "000002").sources == [Source(path=video, frame=2)]


def test_video_without_such_frames_or_of_no_kind_is_refused(tmp_path: Path) -> None:
    video = write_video(tmp_path / "clip.mp4", 25)
    for first in (30, 1e308):
        (reason,) = refusals(listed(video, frames=partial(frame_numbers, first=first)))
        assert "has 25 frames, which take 2.5 s, and none from " in reason and f"{first:g}" in reason
    (reason,) = refusals(listed(video, frames=partial(frame_numbers, first=2.0, last=5)))
    assert "2 s comes after frame 5" in reason
    (tmp_path / "text.mp4").write_text("text")
    found = listed(tmp_path / "text.mp4", "a.jpg")
    assert "cannot be opened as a video" in found.sources[0].refusal and not found.sources[1].refusal
    assert [one.path.name for one in found.sources] == ["text.mp4", "a.jpg"]
