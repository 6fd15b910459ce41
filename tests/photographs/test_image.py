"""Reading photographs: every storage the issue names, and every way to be unusable."""

import io
import os
import struct
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image, TiffImagePlugin

from blur2view.errors import ImageError
from blur2view.photographs.image import BACKDROP, read_image

RGB8 = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)
RGB16 = np.random.default_rng(1).integers(0, 65536, (20, 30, 3), dtype=np.uint16)


def saved(path: Path, pixels: np.ndarray, **options: object) -> Path:
    Image.fromarray(pixels).save(path, **options)  # type: ignore[arg-type]
    return path


@pytest.mark.parametrize("suffix", ["png", "tif", "bmp"])
def test_colour_of_8_bits_is_exact(tmp_path: Path, suffix: str) -> None:
    image = read_image(saved(tmp_path / f"a.{suffix}", RGB8))
    assert image.dtype == np.float32 and image.flags.c_contiguous
    np.testing.assert_array_equal(image, RGB8.astype(np.float32) / np.float32(255))


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_16_bits_are_kept(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    cv2.imwrite(str(path), RGB16[..., ::-1])
    np.testing.assert_allclose(read_image(path), RGB16 / 65535, atol=1e-7)
    grey = read_image(saved(tmp_path / f"grey.{suffix}", RGB16[..., 0]))
    np.testing.assert_allclose(grey, np.repeat(RGB16[..., :1], 3, 2) / 65535, atol=1e-7)


def test_grey_black_and_white_and_palette_are_read(tmp_path: Path) -> None:
    picture = Image.fromarray(RGB8)
    picture.convert("1").save(tmp_path / "bits.png")
    picture.convert("P").save(tmp_path / "palette.png")
    assert set(np.unique(read_image(tmp_path / "bits.png"))) == {0.0, 1.0}
    grey = read_image(saved(tmp_path / "grey.png", RGB8[..., 0]))
    np.testing.assert_array_equal(grey, np.repeat(RGB8[..., :1], 3, 2) / np.float32(255))
    assert read_image(tmp_path / "palette.png").shape == (20, 30, 3)


@pytest.mark.parametrize("mode", ["CMYK", "YCbCr"])
def test_other_colour_models_become_rgb(tmp_path: Path, mode: str) -> None:
    flat = Image.new("RGB", (32, 32), (200, 100, 50)).convert(mode)
    flat.save(tmp_path / "a.jpg", quality=98)
    np.testing.assert_allclose(read_image(tmp_path / "a.jpg")[16, 16] * 255, [200, 100, 50], atol=3)


@pytest.mark.parametrize("depth", [8, 16])
def test_alpha_is_composited_over_grey(tmp_path: Path, depth: int) -> None:
    colour, white = (RGB8, 255) if depth == 8 else (RGB16, 65535)
    alpha = np.full((20, 30), white, colour.dtype)
    alpha[:10] = 0
    cv2.imwrite(str(tmp_path / "a.png"), np.dstack([colour[..., ::-1], alpha]))
    image = read_image(tmp_path / "a.png")
    np.testing.assert_array_equal(image[:10], np.full((10, 30, 3), BACKDROP, np.float32))
    np.testing.assert_allclose(image[10:], colour[10:] / white, atol=1e-6)


@pytest.mark.parametrize(("suffix", "depth"), [("jpg", 8), ("png", 8), ("tif", 8), ("png", 16), ("tif", 16)])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_is_applied(tmp_path: Path, orientation: int, suffix: str, depth: int) -> None:
    ramp = np.linspace(0, 250, 32 * 48).reshape(32, 48)
    exif = Image.Exif()
    exif[0x0112] = orientation
    picture = Image.fromarray(ramp.astype(np.uint8) if depth == 8 else (ramp * 257).astype(np.uint16))
    picture.save(tmp_path / f"a.{suffix}", exif=exif)
    r = ramp / 255
    turned = [r, r[:, ::-1], np.rot90(r, 2), r[::-1], r.T, np.rot90(r, -1), np.rot90(r, 2).T, np.rot90(r, 1)]
    upright = turned[orientation - 1]
    np.testing.assert_allclose(read_image(tmp_path / f"a.{suffix}")[..., 0], upright, atol=0.02)


def jpeg_bytes(size: tuple[int, int] = (200, 150), **options: object) -> bytes:
    pixels = np.random.default_rng(3).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", **options)
    return stream.getvalue()


@pytest.mark.parametrize("progressive", [False, True])
@pytest.mark.parametrize("share", [0.05, 0.3, 0.6, 0.99])
def test_truncated_jpeg_is_refused(tmp_path: Path, share: float, progressive: bool) -> None:
    content = jpeg_bytes(progressive=progressive)
    path = tmp_path / "cut.jpg"
    path.write_bytes(content[: int(len(content) * share)])
    with pytest.raises(ImageError, match=r"cut\.jpg: is (damaged|not a readable image)"):
        read_image(path)


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_truncated_lossless_file_is_refused(tmp_path: Path, suffix: str, depth: int) -> None:
    pixels = RGB8 if depth == 8 else RGB16
    encoded = cv2.imencode(f".{suffix}", pixels)[1].tobytes()
    path = tmp_path / f"cut.{suffix}"
    path.write_bytes(encoded[: len(encoded) // 2])
    with pytest.raises(ImageError, match="cut"):
        read_image(path)


def tiff(path: Path, data: bytes, *, bits: int, photometric: int = 1, planes: int = 1) -> Path:
    """Write a TIFF of 30x20 pixels whose data lie as they are given, one strip per plane."""
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags[256], tags[257], tags[278] = 30, 20, 20
    tags[258], tags[277], tags[259], tags[262] = (bits,) * planes, planes, 1, photometric
    tags[284] = 1 if planes == 1 else 2
    size = len(data) // planes
    tags[273], tags[279] = tuple(range(0, len(data), size)), (size,) * planes  # Pillow adds where they end
    path.write_bytes(b"II*\0\x08\0\0\0" + tags.tobytes(8) + data)
    return path


def test_colour_of_16_bits_in_planes_is_refused(tmp_path: Path) -> None:
    data = np.moveaxis(RGB16, 2, 0).astype("<u2").tobytes()
    with pytest.raises(ImageError, match="separate planes; save it with RGB pixels"):
        read_image(tiff(tmp_path / "a.tif", data, bits=16, photometric=2, planes=3))


def test_grey_of_12_bits_keeps_its_brightness(tmp_path: Path) -> None:
    grey = RGB16[..., 0] >> 4
    even, odd = grey[:, ::2], grey[:, 1::2]
    packed = np.stack([even >> 4, (even & 15) << 4 | odd >> 8, odd & 255], axis=-1).astype(np.uint8)
    image = read_image(tiff(tmp_path / "a.tif", packed.tobytes(), bits=12))
    np.testing.assert_allclose(image[..., 0], grey / 4095, atol=1e-6)


def test_grey_whose_zero_is_white_is_no_negative(tmp_path: Path) -> None:
    data = RGB16[..., 0].astype("<u2").tobytes()
    image = read_image(tiff(tmp_path / "a.tif", data, bits=16, photometric=0))
    np.testing.assert_allclose(image[..., 0], 1 - RGB16[..., 0] / 65535, atol=1e-6)


def test_thumbnail_of_a_raw_file_is_no_photograph(tmp_path: Path) -> None:
    tags = {50706: bytes([1, 4, 0, 0]), 254: 1}  # DNGVersion; NewSubfileType: of reduced resolution
    path = tmp_path / "a.tif"  # else it is given to rawpy
    Image.fromarray(RGB8).save(path, "TIFF", tiffinfo=tags)
    with pytest.raises(ImageError, match="thumbnail of a raw file; develop"):
        read_image(path)
    Image.fromarray(RGB8).save(path, "TIFF", tiffinfo=tags | {254: 0})
    np.testing.assert_array_equal(read_image(path), RGB8 / np.float32(255))


def test_photograph_that_takes_too_much_memory_is_refused_before_it_is_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = saved(tmp_path / "a.png", RGB8)
    monkeypatch.setattr("PIL.PngImagePlugin.PngImageFile.load", lambda picture: pytest.fail("decoded"))
    monkeypatch.setattr("PIL.PngImagePlugin.PngImageFile.size", (13000, 13000))
    with pytest.raises(ImageError, match=r"13000x13000 .* 10\.1 GiB .* --max-memory 11$"):
        read_image(path, max_memory_gib=2)


def bitmap(side: int) -> bytes:
    """Return the header of a bitmap that claims to have this side."""
    header = io.BytesIO()
    Image.new("L", (20, 20)).save(header, "BMP")
    content = bytearray(header.getvalue())
    content[18:26] = side.to_bytes(4, "little") * 2
    return bytes(content)


def encoded(picture: Image.Image, kind: str) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, kind)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"a recipe for soup, not a photograph", "not a readable image"),
        (encoded(Image.new("RGB", (1, 1)), "PNG"), "1x1 pixels"),
        (encoded(Image.new("RGB", (20000, 1)), "PNG"), "20000x1 pixels"),
        (bitmap(40_000), "too many pixels; resize"),
        (bitmap(13_300), "13300x13300 pixels; resize"),
        (encoded(Image.fromarray(np.ones((20, 20), np.float32)), "TIFF"), "floating-point"),
        (encoded(Image.fromarray(np.full((20, 20), 70_000, np.int32)), "TIFF"), "32-bit"),
        ("folder", "is a directory"),
        (None, "no such file"),
    ],
)
def test_unusable_file_is_named_in_one_line(tmp_path: Path, content: bytes | str | None, words: str) -> None:
    path = tmp_path / "photo.jpg"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content:
        path.mkdir()
    with pytest.raises(ImageError) as caught:
        read_image(path)
    message = str(caught.value)
    assert str(path) in message and words in message
    assert "\n" not in message and ";" in message  # one line, with a remedy after the semicolon


@pytest.mark.parametrize(
    ("raised", "words"),
    [
        (KeyError("RGB imago"), "is damaged or incomplete"),  # what Pillow raises on a torn IM file
        (RuntimeError("no image item"), "is damaged or incomplete"),  # and on AVIF
        (MemoryError(), "does not fit in memory; resize it"),
    ],
)
def test_whatever_a_decoder_stumbles_over_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, raised: Exception, words: str
) -> None:
    def stumble(picture: Image.Image) -> None:
        raise raised

    path = saved(tmp_path / "a.png", RGB8)
    monkeypatch.setattr("PIL.PngImagePlugin.PngImageFile.load", stumble)
    with pytest.raises(ImageError, match=words):
        read_image(path)


def test_path_that_cannot_be_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ImageError, match="cannot be read"):
        read_image("a\0b.jpg")

    def denied(path: Path) -> bytes:  # chmod would not stop root
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("blur2view.photographs.image.read_regular", denied)
    with pytest.raises(ImageError, match="Permission denied"):
        read_image(tmp_path / "a.png")


def test_pipe_is_refused_instead_of_waiting_for_its_end(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.jpg")
    for path in (tmp_path / "pipe.jpg", Path("/dev/zero")):
        with pytest.raises(ImageError, match="is no regular file"):
            read_image(path)


def test_what_a_decoder_has_to_say_is_not_printed(tmp_path: Path) -> None:
    path = tmp_path / "samples.tif"
    Image.fromarray(RGB8).save(path)
    data = bytearray(path.read_bytes())
    at = data.index(struct.pack("<HHIH", TiffImagePlugin.SAMPLESPERPIXEL, 3, 1, 3))
    data[at + 8 : at + 10] = struct.pack("<H", 100)
    path.write_bytes(data)
    program = f"from blur2view import read_image; read_image({str(path)!r})"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert "More samples" not in done.stderr and "ImageError" in done.stderr
