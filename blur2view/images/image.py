"""Photographs: decode, refuse what cannot be used, orient upright, scale to [0, 1]."""

import io
import logging
import os
import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image, ImageFile, UnidentifiedImageError

from blur2view.arrays import AnyArray, Floats
from blur2view.errors import ImageError, within_memory
from blur2view.files import open_picture, read_regular
from blur2view.images.depth import in_least_bits
from blur2view.images.exif import ExifValues, read_exif
from blur2view.images.pixels import (
    TOO_LARGE,
    as_floats,
    as_photograph,
    stored_from_upright,
    unusable_size,
    upright_from_stored,
)
from blur2view.images.video import frame_numbers, is_video

# RAW by rawpy, HEIC by pillow-heif: extras.
RAW_SUFFIXES = frozenset(
    [".3fr", ".arw", ".cr2", ".cr3", ".crw", ".dcr", ".dng", ".erf", ".iiq", ".kdc", ".mef", ".mos", ".mrw"]
    + [".nef", ".nrw", ".orf", ".pef", ".raf", ".raw", ".rw2", ".rwl", ".sr2", ".srf", ".srw", ".x3f"]
)
HEIC_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx")
# Files of a folder that are photographs; a file that is named by itself may have any suffix.
PHOTOGRAPH_SUFFIXES = RAW_SUFFIXES | {".avif", ".bmp", ".heic", ".heif", ".hif", ".jfif", ".jp2", ".jpe"}
PHOTOGRAPH_SUFFIXES |= {
    ".gif",
    ".jpeg",
    ".jpg",
    ".mpo",
    ".pgm",
    ".png",
    ".pnm",
    ".ppm",
    ".tga",
    ".tif",
    ".tiff",
    ".webp",
}
Content = bytes | AnyArray
"""What a photograph's file holds, or the pixels (H, W, 3), RGB, uint8, of a frame that has been decoded."""
BITS, SIGNS = ExifTags.Base.BitsPerSample, ExifTags.Base.SampleFormat  # of TIFF
PLANES, TONES = ExifTags.Base.PlanarConfiguration, ExifTags.Base.PhotometricInterpretation
logging.getLogger("PIL").addHandler(logging.NullHandler())  # it prints unless somebody listens


def read_image(
    path: str | os.PathLike[str], *, as_stored: bool = False, content: Content | None = None
) -> NDArray[np.float32]:
    """Return a photograph as upright float32 sRGB-coded RGB (H, W, 3).

    JPEG, PNG, TIFF, WebP, AVIF, JPEG 2000, BMP, GIF, PPM and TGA; 8 or 16 bits; grey, colour, palette or
    CMYK; of several pictures the first. Alpha is composited over mid-grey, embedded colour profiles are
    ignored. RAW and HEIC need their extras.

    Parameters
    ----------
    path : path
        The file; its name alone tells RAW.
    as_stored : bool
        Leave the picture as its pixels lie, as COLMAP does, instead of rotating it by EXIF.
    content : bytes or ndarray of shape (H, W, 3), optional
        The content of the file, where it has been read already; of a frame of a video its pixels.

    Returns
    -------
    ndarray of shape (H, W, 3)
        RGB, float32 in [0, 1].

    Raises
    ------
    ImageError
        One line with the path and the remedy, if the file is missing, damaged, not an image, or of a size
        that cannot be used.

    Examples
    --------
    >>> from blur2view import read_image
    >>> from PIL import Image
    >>> Image.new("RGB", (64, 48), (255, 0, 51)).save("a.png")
    >>> image = read_image("a.png")
    >>> image.shape, image[0, 0].tolist()
    ((48, 64, 3), [1.0, 0.0, 0.20000000298023224])
    """
    picture = read_picture(path, as_stored=as_stored, content=content)
    with within_memory(Path(path)):
        return picture.levels()


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """A photograph that has been read, once: its pixels, and what its EXIF states."""

    pixels: AnyArray
    """(H, W, 3) RGB, sRGB-coded: uint8 or uint16 as in the file; floats in [0, 1] where it had alpha.

    Of a grey photograph all three channels are the same memory, which cannot be written.
    """
    exif: ExifValues = field(default_factory=ExifValues)
    """Focal length, exposure time and direction of the sensor's rows, as far as they are stated."""
    orientation: int = 1
    """EXIF's orientation (tag 0x0112), 1 to 8, by which pixels as they are stored become upright."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        height, width = self.pixels.shape[:2]
        return width, height

    def levels(self) -> Floats:
        """Return the pixels (H, W, 3) as float32 in [0, 1]."""
        return as_floats(self.pixels)


def read_picture(
    path: str | os.PathLike[str], *, as_stored: bool = False, content: Content | None = None
) -> Picture:
    """Return a photograph with its file's bits; parameters and errors are those of `read_image`."""
    path = Path(path)
    if isinstance(content, np.ndarray):
        _check_size(path, *content.shape[1::-1])
        return Picture(pixels=content)
    encoded = read_content(path) if content is None else content
    if not encoded:
        raise ImageError(f"{path}: is empty (0 bytes); copy the photograph again")
    with warnings.catch_warnings(), within_memory(path):
        warnings.simplefilter("ignore")  # Pillow warns of odd EXIF blocks and of sizes that are checked here
        decoded, exif, orientation, upright = _decode(path, encoded, as_stored)
        try:
            values = as_photograph(decoded, path)
        except ValueError as error:
            raise ImageError(f"{path}: {error}; save it with 8 or 16 bits per channel") from None
        if upright == as_stored:
            values = (stored_from_upright if as_stored else upright_from_stored)(values, orientation)
        pixels = np.ascontiguousarray(values)
        if pixels.ndim == 2:
            pixels = np.broadcast_to(pixels[..., None], (*pixels.shape, 3))
        return Picture(pixels=pixels, exif=exif, orientation=orientation)


def read_orientation(path: Path) -> int:
    """Return EXIF's orientation of a photograph, 1 to 8, 1 if none is stated."""
    with suppress(Exception), warnings.catch_warnings():  # Pillow's errors of damaged files have any type
        warnings.simplefilter("ignore")
        with open_picture(read_regular(path)) as photo:
            return _stated_orientation(photo)
    return 1


def _stated_orientation(photo: Image.Image) -> int:
    """Return the orientation that a picture of Pillow states, 1 to 8."""
    orientation = photo.getexif().get(ExifTags.Base.Orientation, 1)
    return int(orientation) if orientation in range(1, 9) else 1


def read_content(path: Path) -> bytes:
    """Return the content of a photograph's file; ImageError if it cannot be read, or is a video."""
    if is_video(path):
        frame_numbers(path)  # raises where the video is unusable
        raise ImageError(f"{path}: is a video; read its frames with blur2view.read_video")
    try:
        return read_regular(path)
    except FileNotFoundError:
        raise ImageError(f"{path}: no such file; check the path") from None
    except IsADirectoryError:
        raise ImageError(f"{path}: is a folder; name a photograph in it") from None
    except OSError as error:
        reason = error.strerror
        raise ImageError(f"{path}: cannot be read ({reason}); check the path and its permissions") from None


def _decode(
    path: Path, encoded: bytes, as_stored: bool
) -> tuple[AnyArray | Image.Image, ExifValues, int, bool]:
    """Decode a photograph: an array of RAW and of 16-bit colour, which Pillow lacks, or a picture of Pillow.

    With it come what its EXIF states, the orientation, and whether it is upright: RAW unless ``as_stored``,
    and TIFF, which Pillow and OpenCV turn.
    """
    try:
        if path.suffix.lower() in RAW_SUFFIXES:
            developed = _develop(path, encoded, as_stored)
            with suppress(Exception), open_picture(encoded) as photo:  # some are TIFF with EXIF
                return developed, read_exif(photo), _stated_orientation(photo), not as_stored
            return developed, ExifValues(), 1, True
        if encoded[4:8] == b"ftyp" and any(brand in encoded[8:64] for brand in HEIC_BRANDS):
            _extra(path, "HEIC", "pillow_heif").register_heif_opener()
        with open_picture(encoded) as photo:
            _check_size(path, *photo.size)
            colour = len(photo.getbands()) > 1
            _refuse_rare(path, getattr(photo, "tag_v2", {}), colour=colour)
            # colour of 16 bits, which Pillow would cut to 8; asked before getexif, which may decode
            deep = colour and any(";16" in str(tile[3]) for tile in photo.tile)
            start, white = _start_and_white(photo)
            orientation, exif = _stated_orientation(photo), read_exif(photo)
            photo.load()  # raises if the file is truncated; OpenCV would return half a picture
            decoded: AnyArray | Image.Image = photo  # loaded, so that it may be closed
            if deep:
                decoded = in_least_bits(_decode_deep(encoded, alpha=photo.has_transparency_data), path)
            elif white > 255:
                decoded = _decode_ppm(encoded, start, white, photo.size, colour=colour)
                decoded = in_least_bits(decoded, path) if white == 65535 else decoded
            return decoded, exif, orientation, photo.format == "TIFF"
    except Image.DecompressionBombError:
        raise ImageError(f"{path}: has too many pixels; {TOO_LARGE}") from None
    except UnidentifiedImageError:
        raise ImageError(f"{path}: is not a readable image; convert it to JPEG, PNG or TIFF") from None
    except (ImageError, MemoryError):
        raise
    except Exception as error:
        # on damaged files Pillow's decoders raise errors of any type: KeyError, RuntimeError, ...
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ImageError(f"{path}: is damaged or incomplete ({reason}); copy the photograph again") from None


def _refuse_rare(path: Path, tags: Mapping[int, Any], *, colour: bool) -> None:
    """Raise ImageError for TIFF that neither decoder reads right."""
    bits = max(tags.get(BITS, (8,)))
    deep = bits > 8 and (tags.get(TONES) == 0 or (colour and tags.get(PLANES) == 2))  # inverted, or in planes
    if bits == 12 or deep or (bits == 8 and 2 in tags.get(SIGNS, ())):
        kind = "of 12 bits, of signed bytes, inverted, or in planes"
        raise ImageError(f"{path}: is a TIFF of a kind that cannot be read ({kind}); save it as PNG")


def _decode_deep(encoded: bytes, *, alpha: bool) -> AnyArray:
    """Return RGB (H, W, 3) of 16 bits or, with ``alpha``, RGBA (H, W, 4), decoded by OpenCV."""
    pixels: Any = cv2.imdecode(np.frombuffer(encoded, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.dtype != np.uint16 or pixels.ndim != 3:
        raise ValueError("its 16-bit pixels cannot be decoded")
    channels = 4 if alpha else 3
    return np.concatenate([pixels[..., 2::-1], pixels[..., 3:channels]], axis=-1)


def _start_and_white(photo: ImageFile.ImageFile) -> tuple[int, int]:
    """Return where the values of a binary PPM or PGM begin, and its white; 0 and 0 of any other file."""
    tiles: list[Any] = [tile for tile in photo.tile if tile[0] == "ppm"]
    return (tiles[0][2], int(tiles[0][3][1])) if tiles else (0, 0)


def _decode_ppm(
    encoded: bytes, start: int, white: int, size: tuple[int, int], *, colour: bool
) -> NDArray[np.uint16]:
    """Return binary PPM (H, W, 3) or PGM (H, W) of a stated white above 255, which becomes 65535."""
    width, height = size
    shape = (height, width, 3) if colour else (height, width)
    values = np.frombuffer(encoded, ">u2", int(np.prod(shape)), start).reshape(shape)
    if white == 65535:
        return values.astype(np.uint16)
    return np.asarray(np.round(np.minimum(values, white) * (65535 / white)), np.uint16)


def _extra(path: Path, kind: str, module: str) -> Any:
    """Import the optional module that reads a kind of files; ImageError if it is not installed."""
    try:
        return import_module(module)
    except ImportError:
        name = module.replace("_", "-")
        remedy = f"install {name} (pip install {name}) or convert it to JPEG"
        raise ImageError(f"{path}: is {kind}; {remedy}") from None


def _develop(path: Path, encoded: bytes, as_stored: bool) -> NDArray[np.uint16]:
    """Return a RAW photograph (H, W, 3): sRGB with the camera's white balance, not brightened."""
    rawpy, flip = _extra(path, "RAW", "rawpy"), 0 if as_stored else None
    try:
        with rawpy.imread(io.BytesIO(encoded)) as raw:
            _check_size(path, raw.sizes.width, raw.sizes.height)
            options = {"use_camera_wb": True, "no_auto_bright": True, "gamma": (2.4, 12.92)}
            pixels: NDArray[np.uint16] = raw.postprocess(output_bps=16, user_flip=flip, **options)
    except rawpy.LibRawError as error:
        reason = " ".join(str(error).split()).removeprefix("b'").removesuffix("'")
        raise ImageError(f"{path}: cannot be developed ({reason}); develop it to JPEG or PNG") from None
    return pixels


def _check_size(path: Path, width: int, height: int) -> None:
    """Raise ImageError for a size that shows no smear or does not fit in memory."""
    if remedy := unusable_size(width, height):
        raise ImageError(f"{path}: is {width}x{height} pixels; {remedy}")
