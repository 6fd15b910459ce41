"""Formats that Pillow does not decode by itself: RAW by rawpy, HEIC by pillow-heif, each an extra."""

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blur2view.errors import ImageError

HEIC_SUFFIXES = frozenset([".heic", ".heif", ".hif"])
RAW_SUFFIXES = frozenset(
    [".3fr", ".arw", ".cr2", ".cr3", ".crw", ".dcr", ".dng", ".erf", ".iiq", ".kdc", ".mef", ".mos", ".mrw"]
    + [".nef", ".nrw", ".orf", ".pef", ".raf", ".raw", ".rw2", ".rwl", ".sr2", ".srf", ".srw", ".x3f"]
)
RAW_MAGIC = (b"FUJIFILMCCD-RAW", b"IIRO", b"IIRS", b"MMOR", b"IIU\0", b"FOVb", b"\0MRM")
HEIC_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx")
LARGEST_FTYP = 64  # bytes: the box that names the brands of a file stands first


def is_raw(path: Path, encoded: bytes) -> bool:
    """Return whether a file is a RAW photograph, by its name or its first bytes."""
    known = encoded.startswith(RAW_MAGIC) or encoded[8:10] == b"CR" or encoded[4:11] == b"ftypcrx"
    return known or path.suffix.lower() in RAW_SUFFIXES


def is_heic(encoded: bytes) -> bool:
    """Return whether a file is HEIC, by the brands that it names."""
    return encoded[4:8] == b"ftyp" and any(brand in encoded[8:LARGEST_FTYP] for brand in HEIC_BRANDS)


def register_heic(path: Path) -> None:
    """Let Pillow open HEIC; ImageError if pillow-heif is not installed."""
    try:
        import pillow_heif
    except ImportError:
        raise ImageError(
            f"{path}: is HEIC; install pillow-heif (pip install pillow-heif) or convert it to JPEG"
        ) from None
    pillow_heif.register_heif_opener()


def develop(
    path: Path, encoded: bytes, *, as_stored: bool, check_size: Callable[[int, int], None]
) -> NDArray[np.uint16]:
    """Return a RAW photograph (H, W, 3), uint16: sRGB with the camera's white balance, not brightened.

    ``encoded`` is the file; ``as_stored`` leaves the picture as it lies; ``check_size`` raises for sizes that
    cannot be used. ImageError if rawpy is not installed or LibRaw cannot develop the file.
    """
    try:
        import rawpy
    except ImportError:
        raise ImageError(f"{path}: is RAW; install rawpy (pip install rawpy) or develop it to JPEG") from None
    try:
        with rawpy.imread(io.BytesIO(encoded)) as raw:
            check_size(raw.sizes.width, raw.sizes.height)
            pixels: NDArray[np.uint16] = raw.postprocess(
                output_bps=16,
                use_camera_wb=True,
                no_auto_bright=True,
                gamma=(2.4, 12.92),
                user_flip=0 if as_stored else None,
            )
    except rawpy.LibRawError as error:
        reason = " ".join(str(error).split()).removeprefix("b'").removesuffix("'")
        raise ImageError(f"{path}: cannot be developed ({reason}); develop it to JPEG or PNG") from None
    return pixels
