"""Photographs and networks that are not what they should be, drawn from a generator of random numbers."""

import io
import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from PIL import ExifTags, Image, TiffImagePlugin
from PIL.PngImagePlugin import PngInfo

from blur2view.networks.model_file import shipped_file
from tools.robustness.damage import Rng, cut, flipped, overwritten

FORMATS = {
    "JPEG": ("RGB", "L", "CMYK"),
    "PNG": ("RGB", "RGBA", "L", "LA", "P", "1", "I;16"),
    "TIFF": ("RGB", "RGBA", "L", "CMYK", "1", "I;16", "F", "I"),
    "WEBP": ("RGB", "RGBA"),
    "BMP": ("RGB", "L", "P"),
    "GIF": ("P",),
    "PPM": ("RGB", "L"),
    "TGA": ("RGB", "RGBA"),
    "ICO": ("RGBA",),
    "JPEG2000": ("RGB", "L"),
    "PCX": ("RGB",),
    "SGI": ("RGB",),
    "DDS": ("RGBA",),
}  # fmt: skip
"""Formats that Pillow writes, and modes of each."""
NAMES = (
    "a b.jpg", "\n.jpg", "\x1b[31m.png", "ü.jpg", "-o.jpg", "#open.jpg", "a#close.png", "%s.jpg", "a,b.jpg",
    "..jpg", "'.jpg", '".jpg', "\u202e.jpg", "a" * 240 + ".jpg", os.fsdecode(b"\xff\xfe.jpg"), "<b>.jpg",
    "&amp;.png", "<!--.jpg", "$HOME.jpg", "*.jpg",
)  # fmt: skip
DEVICES = ("/dev/zero", "/dev/null", "/dev/tty", "/proc/self/mem", "/proc/kmsg", "/")
ABSURD = (0.0, -1.0, 1e300, 1e-300, float("nan"), float("inf"), 1e9, 5e-324)


def blurred(rng: Rng, size: tuple[int, int] | None = None) -> Image.Image:
    """Return a small picture of noise smeared sideways, RGB."""
    width, height = size or (int(rng.integers(64, 160)), int(rng.integers(64, 120)))
    noise = rng.uniform(0, 255, (height, width, 3))
    smeared = np.mean([np.roll(noise, shift, axis=1) for shift in range(9)], axis=0)
    return Image.fromarray(smeared.astype(np.uint8))


def encoded(rng: Rng, kind: str | None = None, picture: Image.Image | None = None) -> bytes:
    """Return a picture in a format and mode that Pillow writes."""
    kind = kind or str(rng.choice(list(FORMATS)))
    mode = str(rng.choice(FORMATS[kind]))
    picture = picture or blurred(rng)
    if mode in ("I;16", "I", "F"):
        grey = np.asarray(picture.convert("L"))
        wide = {"I;16": np.uint16, "I": np.int32, "F": np.float32}[mode]
        picture = Image.fromarray(grey.astype(wide) * wide(rng.choice([1, 256])))
    else:
        picture = picture.convert(mode)
    stream = io.BytesIO()
    picture.save(stream, kind)
    return stream.getvalue()


def header(rng: Rng) -> bytes:
    """Return a picture whose first bytes are flipped."""
    data = encoded(rng)
    return flipped(data, rng, 12, (0, min(len(data), 200)))


def spliced(rng: Rng) -> bytes:
    """Return the first part of one picture and the last of another."""
    one, other = encoded(rng), encoded(rng)
    return one[: int(rng.integers(0, len(one)))] + other[int(rng.integers(0, len(other))) :]


def no_picture(rng: Rng) -> bytes:
    """Return what is no picture: nothing, a text, noise, the beginning of an archive, a database."""
    kinds = [
        b"", b"photograph\n" * 99, rng.bytes(5000), b"PK\3\4" + rng.bytes(99), b"SQLite format 3\0" * 9,
        b"<html></html>", bytes(4096), b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n", b"II*\0", b"%PDF-1.7\n",
        b"<svg xmlns='http://www.w3.org/2000/svg' width='99' height='99'/>", b"RIFF\0\0\0\0WEBP",
    ]  # fmt: skip
    return kinds[int(rng.integers(len(kinds)))]


def odd_size(rng: Rng) -> bytes:
    """Return a picture that is very small, narrow or constant."""
    sizes = [(1, 1), (15, 400), (16, 16), (17, 900), (2000, 16), (3, 3), (64, 65), (16, 17), (31, 33)]
    size = sizes[int(rng.integers(len(sizes)))]
    picture = blurred(rng, size)
    if rng.random() < 0.4:
        picture = Image.new("RGB", size, tuple(rng.integers(0, 256, 3).tolist()))
    return encoded(rng, str(rng.choice(["PNG", "JPEG", "TIFF", "BMP"])), picture)


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def bomb(rng: Rng) -> bytes:
    """Return a small file that claims, or unfolds to, very many pixels or bytes."""
    side = int(rng.choice([8000, 13000, 30000, 65000, 2**31 - 1]))
    depth, colour = ((1, 0), (8, 2), (16, 6), (8, 0))[int(rng.integers(4))]
    kind = int(rng.integers(5))
    if kind == 0:  # the pixels are there if they are few enough to make
        rows = zlib.compress(bytes(min(side * side // 8, 30_000_000)), 9)
        size = struct.pack(">IIBBBBB", side, side, depth, colour, 0, 0, 0)
        return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", size) + _chunk(b"IDAT", rows) + _chunk(b"IEND", b"")
    if kind == 1:
        data = bytearray(encoded(rng, "JPEG", blurred(rng)))
        at = max(data.find(b"\xff\xc0"), 0)
        data[at + 5 : at + 9] = struct.pack(">HH", min(side, 65535), min(side, 65535))
        return bytes(data)
    if kind == 2:
        data = bytearray(encoded(rng, "BMP", blurred(rng)))
        data[18:26] = struct.pack("<ii", side, int(rng.choice([side, -side, 0])))
        return bytes(data)
    if kind == 3:
        text = PngInfo()
        text.add_text("comment", "0" * int(rng.choice([10**5, 10**7, 7 * 10**7])), zip=True)
        stream = io.BytesIO()
        blurred(rng).save(stream, "PNG", pnginfo=text)
        return stream.getvalue()
    tiff = bytearray(encoded(rng, "TIFF", blurred(rng)))
    for _ in range(4):  # lengths, offsets, counts
        at = int(rng.integers(8, min(len(tiff) - 4, 300)))
        tiff[at : at + 4] = struct.pack("<I", int(rng.choice([side, 2**32 - 1, 2**31, 0])))
    return bytes(tiff)


def absurd_exif(rng: Rng) -> bytes:
    """Return a JPEG or TIFF whose EXIF says what cannot be."""
    base, exif = ExifTags.Base, Image.Exif()
    part = exif.get_ifd(ExifTags.IFD.Exif)
    for tag in (base.FocalLength, base.FocalPlaneXResolution, base.ExposureTime, base.FocalLengthIn35mmFilm,
                base.ExifImageWidth, base.FocalPlaneResolutionUnit):  # fmt: skip
        value: Any = float(rng.choice(ABSURD))
        if tag.value in (0xA405, 0xA210, 0xA002):  # integers
            value = int(np.nan_to_num(min(max(value, 0), 65535)))
        if rng.random() >= 0.7:
            continue
        if not abs(value) < 1e9:  # NaN, too
            value = TiffImagePlugin.IFDRational(*(int(rng.choice([0, 1, 2**32 - 1])) for _ in range(2)))
        part[tag] = value
    exif[base.Orientation] = int(rng.choice([0, 1, 3, 6, 8, 9, 99, 65535]))
    stream = io.BytesIO()
    picture = blurred(rng)
    try:
        block = exif.tobytes()
    except Exception:  # what Pillow cannot write is written as noise
        block = b"Exif\0\0MM\0*" + rng.bytes(200)
    if rng.random() < 0.3:
        damaged = bytearray(block)
        for at in rng.integers(6, len(damaged), 6):
            damaged[at] ^= int(rng.integers(1, 256))
        block = bytes(damaged)
    picture.save(stream, "JPEG", exif=block)
    return stream.getvalue()


CONTENTS: dict[str, Callable[[Rng], bytes]] = {
    "cut short": lambda rng: cut(encoded(rng), rng),
    "bits flipped": lambda rng: flipped(encoded(rng), rng, 40),
    "header flipped": header,
    "overwritten": lambda rng: overwritten(encoded(rng), rng, 3000, zeros=True),
    "two spliced": spliced,
    "no picture": no_picture,
    "rare format": encoded,
    "odd size": odd_size,
    "bomb": bomb,
    "absurd EXIF": absurd_exif,
}


def odd_place(folder: Path, rng: Rng, number: int) -> Path:
    """Make what is no regular file, or a file of an odd name, and return its path."""
    path = folder / f"place{number}.jpg"
    match int(rng.integers(8)):
        case 0:
            path.mkdir()
        case 1:
            path.symlink_to(path.name)
        case 2:
            path.symlink_to("nowhere.jpg")
        case 3:
            os.mkfifo(path)
        case 4:
            return Path(str(rng.choice(DEVICES)))
        case 5:
            return folder / f"absent{number}.jpg" / ".." / "x"
        case 6:
            path = folder / f"{number}" / str(rng.choice(NAMES))
            path.parent.mkdir()
            blurred(rng).save(path, "JPEG")
        case _:
            return folder / ("n" * 300 + f"{number}.jpg")
    return path


def hostile_photograph(folder: Path, rng: Rng, number: int) -> Path:
    """Make a hostile photograph, all kinds by turns, and return its path."""
    kinds = [*CONTENTS, "odd place"]
    kind = kinds[number % len(kinds)]
    if kind == "odd place":
        return odd_place(folder, rng, number)
    suffix = str(rng.choice([".jpg", ".png", ".tif", ".webp", "", ".JPG", ".txt"]))
    path = folder / f"{number}{suffix}"
    path.write_bytes(CONTENTS[kind](rng))
    return path


def hostile_model(folder: Path, rng: Rng, number: int) -> Path:
    """Make a hostile network of the shipped one, all kinds by turns, and return its path."""
    data, path = shipped_file("smear.onnx").read_bytes(), folder / f"{number}.onnx"
    spans = {1: (0, len(data)), 2: (0, 3000), 4: (len(data) - 3000, len(data))}
    match number % 7:
        case 0:
            data = cut(data, rng)
        case 1 | 2 | 4 as part:
            data = flipped(data, rng, 20, spans[part])
        case 3:
            data = _with_metadata(data, rng)
        case 5:
            data = no_picture(rng)
        case _:
            places = [Path("/dev/zero"), Path("/"), folder / "absent.onnx", folder / "a\0b.onnx"]
            return places[int(rng.integers(4))]
    path.write_bytes(data)
    return path


def _with_metadata(data: bytes, rng: Rng) -> bytes:
    """Return a network whose metadata says, once more and differently, what it is."""
    values = ["0", "-4", "1e9", "9" * 5000, "", "NaN", "[" * 100_000, "ü", "4", "1024", "\0", "x" * 1_000_000]
    key = str(rng.choice(["stride", "multiple_of", "training", "model_id", "blur2view_format"]))
    model = onnx.load_from_string(data)
    model.metadata_props.add(key=key, value=values[int(rng.integers(len(values)))])
    return bytes(model.SerializeToString())
