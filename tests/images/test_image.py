"""Reading photographs: every storage that is promised, and every way to be unusable."""

import io
import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image, PngImagePlugin, TiffImagePlugin

from blur2view.errors import ImageError
from blur2view.images.image import read_image, read_orientation, read_picture
from blur2view.images.pixels import BACKDROP, stored_from_upright

RGB8 = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)
RGB16 = np.random.default_rng(1).integers(0, 65536, (20, 30, 3), dtype=np.uint16)


def saved(path: Path, pixels: np.ndarray, **options: object) -> Path:
    Image.fromarray(pixels).save(path, **options)  # type: ignore[arg-type]
    return path


@pytest.mark.parametrize("suffix", ["png", "tif", "bmp"])
def test_8_bits_are_exact_and_16_bits_are_kept(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    for pixels in (RGB8, RGB8[..., 0]):
        image = read_image(saved(path, pixels))
        assert image.dtype == np.float32 and image.flags.c_contiguous
        expected = np.broadcast_to(pixels.reshape(20, 30, -1), (20, 30, 3))
        np.testing.assert_array_equal(image, expected / np.float32(255))
    if suffix != "bmp":
        cv2.imwrite(str(path), RGB16[..., ::-1])
        np.testing.assert_allclose(read_image(path), RGB16 / 65535, atol=1e-7)
        grey = read_image(saved(path, RGB16[..., 0]))
        np.testing.assert_allclose(grey, np.repeat(RGB16[..., :1], 3, 2) / 65535, atol=1e-7)


@pytest.mark.parametrize(
    ("mode", "name", "shown"),
    [("CMYK", "a.jpg", (200, 100, 50)), ("P", "a.png", (204, 102, 51)), ("1", "a.png", (0, 0, 0))],
)
def test_other_colour_models_become_rgb(tmp_path: Path, mode: str, name: str, shown: tuple[int, ...]) -> None:
    flat = Image.new("RGB", (32, 32), (200, 100, 50)).convert(mode, dither=Image.Dither.NONE)
    flat.save(tmp_path / name, quality=98)
    np.testing.assert_allclose(read_image(tmp_path / name)[16, 16] * 255, shown, atol=3)


@pytest.mark.parametrize(("colour", "white"), [(RGB8, 255), (RGB16, 65535)], ids=["8", "16"])
def test_alpha_is_composited_over_grey(tmp_path: Path, colour: np.ndarray, white: int) -> None:
    alpha = np.full((20, 30), white, colour.dtype)
    alpha[:10] = 0
    cv2.imwrite(str(tmp_path / "a.png"), np.dstack([colour[..., ::-1], alpha]))
    image = read_image(tmp_path / "a.png")
    np.testing.assert_array_equal(image[:10], np.full((10, 30, 3), BACKDROP, np.float32))
    np.testing.assert_allclose(image[10:], colour[10:] / white, atol=1e-6)


@pytest.mark.parametrize(("suffix", "depth"), [("jpg", 8), ("png", 8), ("png", 16), ("tif", 16)])
def test_orientation_is_applied(tmp_path: Path, suffix: str, depth: int) -> None:
    r = np.linspace(0, 250, 32 * 48).reshape(32, 48) / 255
    picture = Image.fromarray((r * 255).astype(np.uint8) if depth == 8 else (r * 65535).astype(np.uint16))
    turned = [r, r[:, ::-1], np.rot90(r, 2), r[::-1], r.T, np.rot90(r, -1), np.rot90(r, 2).T, np.rot90(r, 1)]
    for orientation, upright in enumerate(turned, start=1):
        exif = Image.Exif()
        exif[0x0112] = orientation
        picture.save(tmp_path / f"a.{suffix}", exif=exif)
        np.testing.assert_allclose(read_image(tmp_path / f"a.{suffix}")[..., 0], upright, atol=0.02)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_as_stored_turns_nothing_and_turned_16_bit_colour_keeps_its_bits(
    tmp_path: Path, suffix: str, bits: int
) -> None:
    pixels = RGB8 if bits == 8 else RGB16
    for orientation in range(1, 9):
        path = tmp_path / f"a.{suffix}"
        if suffix == "tif":
            colour = {256: 30, 257: 20, 258: (bits,) * 3, 262: 2, 277: 3, 278: 20}
            tiff(path, pixels, bits=bits, tags=colour | {274: orientation})
        else:
            path.write_bytes(
                with_orientation(cv2.imencode(".png", pixels[..., ::-1])[1].tobytes(), orientation)
            )
        picture = read_picture(path, as_stored=True)
        np.testing.assert_array_equal(picture.pixels, pixels)
        assert picture.orientation == orientation == read_orientation(path)
        upright = read_picture(path).pixels
        np.testing.assert_array_equal(stored_from_upright(upright, orientation), pixels)


def with_orientation(png: bytes, orientation: int) -> bytes:
    """Return a PNG with an EXIF chunk, behind its header, that states an orientation."""
    exif = Image.Exif()
    exif[0x0112] = orientation
    chunk = b"eXIf" + exif.tobytes().removeprefix(b"Exif\0\0")
    framed = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return png[:33] + framed + png[33:]


def test_png_with_a_long_comment_is_read(tmp_path: Path) -> None:
    comment = PngImagePlugin.PngInfo()
    comment.add_text("Comment", "x" * (2 << 20), zip=True)
    path = saved(tmp_path / "a.png", RGB8, pnginfo=comment)
    np.testing.assert_array_equal(read_picture(path).pixels, RGB8)


@pytest.mark.parametrize("share", [0.05, 0.9])
@pytest.mark.parametrize("kind", ["png", "tif", "jpg", "progressive jpg"])
def test_truncated_file_is_refused(tmp_path: Path, kind: str, share: float) -> None:
    *progressive, suffix = kind.split()
    options = [cv2.IMWRITE_JPEG_PROGRESSIVE, 1] if progressive else []
    path = tmp_path / f"cut.{suffix}"
    for pixels in (RGB8, RGB8 if suffix == "jpg" else RGB16):
        content = cv2.imencode(f".{suffix}", pixels, options)[1].tobytes()
        path.write_bytes(content[: int(len(content) * share)])
        with pytest.raises(ImageError, match=r"cut\.\w+: is (damaged|not a readable image)"):
            read_image(path)


def tiff(path: Path, data: np.ndarray, *, bits: int = 16, planes: int = 1, tags: dict[int, Any]) -> Path:
    """Write a TIFF whose data lie as they are given, one strip per plane, with these tags."""
    height, width = data.shape[-2:]
    content, size = data.tobytes(), data.nbytes // planes
    written = TiffImagePlugin.ImageFileDirectory_v2()
    written.tagtype |= {33421: 3, 33422: 1, 50721: 10}  # of a DNG
    layout = {256: width, 257: height, 258: (bits,) * planes, 259: 1, 277: planes, 278: height}
    strips = {273: tuple(range(0, data.nbytes, size)), 279: (size,) * planes}  # Pillow adds where they end
    for number, value in (layout | strips | {262: 1, 284: 1} | tags).items():
        written[number] = value
    path.write_bytes(b"II*\0\x08\0\0\0" + written.tobytes(8) + content)
    return path


@pytest.mark.parametrize(
    ("data", "layout"),
    [
        (np.moveaxis(RGB16, 2, 0), {"planes": 3, "tags": {262: 2, 284: 2}}),
        (RGB16[..., 0], {"tags": {262: 0}}),  # inverted
        (RGB16[..., 0], {"bits": 12, "tags": {}}),
        (RGB8[..., 0], {"bits": 8, "tags": {339: 2}}),  # signed
    ],
)
def test_tiff_that_no_decoder_reads_right_is_refused(
    tmp_path: Path, data: np.ndarray, layout: dict[str, Any]
) -> None:
    path = tiff(tmp_path / "rare.tif", data, **layout)
    with pytest.raises(ImageError, match="is a TIFF of a kind that cannot be read .*; save it as PNG"):
        read_image(path)


def encoded(picture: Image.Image, kind: str) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, kind)
    return stream.getvalue()


def bitmap(side: int) -> bytes:
    """Return the header of a bitmap that claims to have this side."""
    content = encoded(Image.new("L", (20, 20)), "BMP")
    return content[:18] + side.to_bytes(4, "little") * 2 + content[26:]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"a recipe for soup, not a photograph", "not a readable image"),
        (encoded(Image.new("RGB", (1, 1)), "PNG"), "1x1 pixels"),
        (encoded(Image.new("1", (16, 65535)), "PNG"), "16x65535 pixels; cut it"),
        (bitmap(40_000), "too many pixels; resize"),
        (bitmap(13_300), "13300x13300 pixels; resize"),
        (encoded(Image.fromarray(np.full((20, 20), 1.5, np.float32)), "TIFF"), "got 1.5 to 1.5; save it"),
        (
            encoded(Image.fromarray(np.full((20, 20), 70_000, np.int32)), "TIFF"),
            "go from 70000 to 70000, so that its white is unknown; save it",
        ),
        ("folder", "is a folder; name a photograph in it"),
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
