"""Formats that come by extras, and files of several pictures."""

import os
import shutil
import socket
import struct
import subprocess
import sys
from contextlib import chdir
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import cv2
import numpy as np
import pytest
from PIL import Image

from blur2view.arrays import AnyArray
from blur2view.errors import ImageError
from blur2view.images import video
from blur2view.images.image import read_image
from blur2view.images.inputs import Source, frame_named, list_photographs
from blur2view.images.video import EndOfVideo, frame_numbers, read_frame, rows_towards
from tests.images.test_image import tiff
from tests.support.many_photographs import write_frames, write_video

GREY = np.full((40, 60, 3), 118, np.uint8)


def dng(path: Path, orientation: int = 1) -> Path:
    """Write a DNG of red, green, green and blue pixels; its left half is darker than its right half."""
    plane = np.full((48, 64), 8000, np.uint16)
    plane[:, 32:] = 30000
    bayer = {262: 32803, 33421: (2, 2), 33422: bytes([0, 1, 1, 2]), 50721: tuple(np.eye(3).ravel().tolist())}
    return tiff(path, plane, tags=bayer | {271: "Test", 274: orientation, 50706: bytes([1, 4, 0, 0])})


def test_raw_is_developed_upright_in_linear_light_whatever_its_name(tmp_path: Path) -> None:
    pytest.importorskip("rawpy")
    path = dng(tmp_path / "a.NEF")
    image = read_image(path)
    assert image.shape == (48, 64, 3) and image.dtype == np.float32
    dark, light = image[10:-10, 8:24].mean(axis=(0, 1)), image[10:-10, 40:56].mean(axis=(0, 1))
    assert (light > dark + 0.2).all()
    dng(path, orientation=6)
    assert read_image(path).shape == (64, 48, 3)
    assert read_image(path, as_stored=True).shape == (48, 64, 3)
    path.write_bytes(b"II*\0" + bytes(100))
    with pytest.raises(ImageError, match=r"a\.NEF: cannot be developed"):
        read_image(path)


def test_heic_is_read(tmp_path: Path) -> None:
    pillow_heif = pytest.importorskip("pillow_heif")
    path = tmp_path / "a.heic"
    pillow_heif.from_pillow(Image.fromarray(GREY)).save(path)
    np.testing.assert_allclose(read_image(path), 118 / 255, atol=0.02)
    path.rename(tmp_path / "a.jpg")
    assert read_image(tmp_path / "a.jpg").shape == (40, 60, 3)


def test_without_the_extra_the_error_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, module in (("a.heic", "pillow_heif"), ("a.cr2", "rawpy")):
        monkeypatch.setitem(sys.modules, module, None)
        (tmp_path / name).write_bytes(b"\0\0\0\x18ftypheic\0\0\0\0mif1heic")
        with pytest.raises(ImageError, match=f"install {module.replace('_', '-')}"):
            read_image(tmp_path / name)


@pytest.mark.parametrize("kind", ["gif", "webp", "png", "tif"])
def test_of_several_pictures_the_first_is_read(tmp_path: Path, kind: str) -> None:
    pages = [Image.fromarray(GREY + 20 * index) for index in range(2)]
    pages[0].save(tmp_path / f"a.{kind}", save_all=True, append_images=pages[1:])
    np.testing.assert_allclose(read_image(tmp_path / f"a.{kind}"), GREY / np.float32(255), atol=0.02)


def test_frame_is_read_by_its_number_in_any_order(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.mp4", 40)
    for number in (30, 2, 31, 39):
        source = frame_named(f"{clip}/{number:06d}")
        assert source == Source(path=clip, frame=number) and str(source) == f"{clip}/{number:06d}"
        picture = read_image(clip, content=source.read())
        np.testing.assert_allclose(picture.mean(), (20 + 2 * number) / 255, atol=0.02)
    assert read_frame(clip, 0).shape == (64, 80, 3)
    with pytest.raises(ImageError, match="is a video; read its frames"):
        read_image(clip)
    assert frame_named(str(tmp_path / "000002")) is None


def test_rows_of_a_video_that_is_turned_upright(tmp_path: Path) -> None:
    def matrix(a: int, b: int, c: int, d: int) -> bytes:  # of a track's header, 16.16 and 2.30
        return struct.pack(">9i", a << 16, b << 16, 0, c << 16, d << 16, 0, 0, 0, 1 << 30)

    content = write_video(clip := tmp_path / "clip.mp4", 3).read_bytes()
    assert read_frame(clip, 0).shape == (64, 80, 3) and rows_towards(clip) == (0, 1)
    place = content.index(matrix(1, 0, 0, 1), content.index(b"tkhd"))
    turned = tmp_path / "turned.mp4"
    turned.write_bytes(content[:place] + matrix(0, 1, -1, 0) + content[place + 36 :])
    assert read_frame(turned, 0).shape == (80, 64, 3) and rows_towards(turned) == (-1, 0)


def test_names_of_videos_are_names_of_files_and_open_no_network(tmp_path: Path) -> None:
    write_video(tmp_path / "clip.mp4", 3)
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.2)
        address = f"127.0.0.1:{server.getsockname()[1]}"
        names = ["2024-01-01T12:30:00.mp4", f"tcp:{address}?.mp4", f"http:/{address}/x.mp4", "async:clip.mp4"]
        for name in names:
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(tmp_path / "clip.mp4", tmp_path / name)
        with chdir(tmp_path):
            assert [read_frame(Path(name), 0).shape for name in names] == [(64, 80, 3)] * 4
        with pytest.raises(TimeoutError):
            server.accept()
    odd = tmp_path / os.fsdecode(b"\xff.mp4")
    shutil.copy(tmp_path / "clip.mp4", odd)
    with pytest.raises(ImageError, match="cannot open its name, which is not UTF-8"):
        read_frame(odd, 0)


def test_png_are_written_beside_pycolmap(tmp_path: Path) -> None:
    program = "import blur2view, pycolmap; from PIL import Image; Image.new('RGB', (20, 20)).save('a.png')"
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True)
    assert read_image(tmp_path / "a.png").shape == (20, 20, 3)


@pytest.mark.parametrize(
    ("announced", "last_s", "whole"),
    [(40, 3.9, True), (50, 3.9, True), (51, 3.9, False), (90, 3.9, False), (90, 8.5, True)],
)  # the last one has a varying rate
def test_video_that_is_cut_off_is_told_from_one_whose_last_frames_were_never_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, announced: int, last_s: float, whole: bool
) -> None:
    frames = iter(range(40))  # fewer than announced, ten a second
    cut = SimpleNamespace(
        grab=lambda: next(frames, None) is not None,
        get={
            cv2.CAP_PROP_FRAME_COUNT: announced,
            cv2.CAP_PROP_FPS: 10,
            cv2.CAP_PROP_POS_MSEC: 1000 * last_s,
        }.get,
        retrieve=lambda: (True, GREY),
    )
    monkeypatch.setattr(video, "_opened", lambda path: cut)
    clip = tmp_path / "cut.mp4"
    clip.write_bytes(bytes(announced))
    assert read_frame(clip, 39).shape == GREY.shape
    for number in range(40, announced):
        with pytest.raises(EndOfVideo, match=f"ends after 40 of {announced} frames") as caught:
            read_frame(clip, number)
        assert caught.value.whole == whole
    with pytest.raises(ImageError, match=f"none with the number {announced}"):
        read_frame(clip, announced)


@pytest.mark.parametrize("name", ["a.h264", "a.mp4"])
def test_a_stream_without_a_container_has_frames_but_no_rate(tmp_path: Path, name: str) -> None:
    pictures = [cv2.imencode(".jpg", np.full((48, 64, 3), 20 * k, np.uint8))[1] for k in range(8)]
    clip = tmp_path / name
    clip.write_bytes(b"".join(map(bytes, pictures)))  # a stream of JPEG, which FFmpeg takes for 25 a second
    (sources,) = [list_photographs([str(tmp_path)]).sources]
    assert [source.frame for source in sources] == list(range(8))
    assert abs(read_frame(clip, 6).mean() - 120) < 2
    with pytest.raises(ImageError, match=r"states no frame rate; name frames .* -c copy a\.mp4"):
        frame_numbers(clip, last=0.2)


@pytest.mark.parametrize("step_ms", [0, 40])
def test_frames_of_a_stream_have_all_a_time_or_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step_ms: int
) -> None:
    def opened(path: Path) -> SimpleNamespace:
        numbers, shown = iter(range(3)), [0]

        def grab() -> bool:
            shown.append(next(numbers, -1))
            return shown[-1] >= 0

        return SimpleNamespace(
            get=lambda key: step_ms * shown[-1] if key == cv2.CAP_PROP_POS_MSEC else 0,
            set=lambda key, value: True,
            grab=grab,
        )

    monkeypatch.setattr(video, "_opened", opened)
    clip = tmp_path / f"{step_ms}.h264"
    clip.write_bytes(bytes(3))
    times = [video.frame_time(clip, k) for k in range(3)]
    assert times == ([0.0, 0.04, 0.08] if step_ms else [None] * 3)


def test_a_video_that_is_written_anew_is_read_anew(tmp_path: Path) -> None:
    for light in (40, 200):
        clip = write_frames(tmp_path / "a.mp4", [np.full((64, 80, 3), light, np.uint8)] * 3)
        os.utime(clip, (light, light))  # both are of one size, and a clock may tick but every 10 ms
        read = read_frame(clip, 0)
        assert abs(float(read.mean()) - light) < 20


@pytest.mark.parametrize("kind", [np.int32, np.uint16])
def test_8_bits_in_a_wider_file_are_read_as_8_bits(tmp_path: Path, kind: type) -> None:
    plane: AnyArray = (np.arange(64 * 48).reshape(48, 64) % 250).astype(kind)
    Image.fromarray(plane).save(tmp_path / "a.tif")
    np.testing.assert_allclose(read_image(tmp_path / "a.tif")[..., 0], plane / 255, atol=1e-6)
    Image.fromarray(plane * 200).save(tmp_path / "a.tif")
    np.testing.assert_allclose(read_image(tmp_path / "a.tif")[..., 0], plane / 65535 * 200, atol=1e-6)


@pytest.mark.parametrize("suffix", ["png", "tif", "pgm", "ppm"])
def test_a_dark_frame_among_brighter_ones_of_16_bits_is_as_dark_as_they_say(
    tmp_path: Path, suffix: str
) -> None:
    shape = (48, 64, 3) if suffix == "ppm" else (48, 64)
    dark = (np.arange(np.prod(shape)).reshape(shape) % 250).astype(np.uint16)
    cv2.imwrite(str(tmp_path / f"a.{suffix}"), dark)
    assert read_image(tmp_path / f"a.{suffix}").max() == pytest.approx(249 / 255)  # as nothing says otherwise
    cv2.imwrite(str(tmp_path / f"b.{suffix}"), dark * 100)
    assert read_image(tmp_path / f"a.{suffix}").max() == pytest.approx(249 / 65535)


def test_a_content_is_read_where_its_folder_has_no_such_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, content = cv2.imencode(".png", np.full((48, 64), 200, np.uint16))  # as the worker of a cluster gets it
    path = tmp_path / "a.png"
    assert read_image(path, content=content.tobytes()).max() == pytest.approx(200 / 255)
    monkeypatch.setattr(os, "listdir", Mock(side_effect=PermissionError))
    assert read_image(path, content=content.tobytes()).max() == pytest.approx(200 / 255)


def test_a_dark_frame_among_brighter_ones_of_8_bits_is_as_dark_as_they_say(tmp_path: Path) -> None:
    for name, white in {"a": 60, "b": 200}.items():
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.full((48, 64), white, np.uint16))
        assert read_image(tmp_path / "a.png").max() == pytest.approx(60 / (65535 if name == "a" else 255))


def test_what_is_dark_in_8_bits_as_well_is_as_dark_as_its_file_says(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "cap.png"), np.full((48, 64), 90, np.uint16))
    assert read_image(tmp_path / "cap.png").max() == pytest.approx(90 / 65535)


def test_8_bits_beside_an_alpha_of_16_are_read_as_8_bits(tmp_path: Path) -> None:
    pixels = np.full((48, 64, 4), 65535, np.uint16)
    pixels[..., :3] = 200
    cv2.imwrite(str(tmp_path / "a.png"), pixels)
    assert read_image(tmp_path / "a.png").max() == pytest.approx(200 / 255)


@pytest.mark.parametrize(("kind", "channels"), [("P5", 1), ("P6", 3)])
def test_portable_maps_have_all_bits_and_the_white_that_they_state(
    tmp_path: Path, kind: str, channels: int
) -> None:
    values = (np.arange(48 * 64 * channels) % 200 + 12).astype(">u2")
    (tmp_path / "a.pnm").write_bytes(f"{kind} 64 48 1023\n".encode() + values.tobytes())
    expected = values.reshape(48, 64, channels) / 1023
    np.testing.assert_allclose(read_image(tmp_path / "a.pnm")[..., :channels], expected, atol=1e-5)


@pytest.mark.parametrize("scale", [-1, 1 << 20])
def test_integers_of_unknown_white_are_refused_with_their_range(tmp_path: Path, scale: int) -> None:
    Image.fromarray(np.arange(32 * 32, dtype=np.int32).reshape(32, 32) * scale).save(tmp_path / "a.tif")
    with pytest.raises(ImageError, match=r"its values go from .* so that its white is unknown; save it with"):
        read_image(tmp_path / "a.tif")
