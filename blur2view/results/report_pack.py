"""Arrays and pictures as text that an HTML page can carry: quantised, delta-coded, deflated, base64."""

import base64
import zlib
from io import BytesIO
from typing import Any, TypedDict

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

PICTURE_SIDE_PX = 2048  # the longer side of an embedded photograph at most: Full HD stays as it is
PICTURE_QUALITY, THUMBNAIL_QUALITY = 90, 80  # of JPEG; a 1280x720 street has 160 kB at 90
THUMBNAIL_SIDE_PX = 400


class Packed(TypedDict):
    """An array as text, see `packed`: the integers' type, shape, what one of them stands for, base64."""

    type: str
    shape: list[int]
    step: float
    data: str


def packed(values: NDArray[Any], kind: str, step: float = 1.0) -> Packed:
    """Return an array of finite numbers as integers of a type, ``value / step`` rounded.

    Differences along the last axis, modulo the type's range, are split into planes of bytes, low bytes first,
    deflated and written in base64; ``report_page/unpack.js`` is the inverse. ``kind`` is "uint8", "int16",
    "uint16" or "int32"; ``step``, what one stands for, is doubled until the type holds every value.

    Raises
    ------
    ValueError
        If a value is not finite, or negative where the type is unsigned.
    """
    values = np.asarray(values)
    if not np.isfinite(values).all():
        raise ValueError("only finite values can be packed")
    limits = np.iinfo(kind)
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    if low < 0 and limits.min == 0:
        raise ValueError(f"{kind} holds no negative values, got {low}")
    while high / step > limits.max or low / step < limits.min:
        step *= 2
    integers = np.round(values / step).astype(f"<{np.dtype(kind).str[1:]}")
    deltas = integers.copy()
    deltas[..., 1:] -= integers[..., :-1]  # wraps around, as the sums on the page do
    planes = deltas.view(np.uint8).reshape(-1, integers.dtype.itemsize).T
    data = zlib.compress(planes.tobytes(), 6)  # 9: 25 times as long, 0.5 % less
    shape = list(integers.shape)
    return {"type": kind, "shape": shape, "step": step, "data": base64.b64encode(data).decode()}


def picture(
    image: NDArray[np.float32], side_px: int = PICTURE_SIDE_PX, quality: int = PICTURE_QUALITY
) -> str:
    """Return a photograph (H, W, 3), sRGB-coded in [0, 1], as the data URI of a JPEG of at most this side."""
    height, width = image.shape[:2]
    scale = min(side_px / max(height, width), 1.0)
    if scale < 1:
        size = max(round(width * scale), 1), max(round(height * scale), 1)
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.float32)
    levels = np.round(255 * np.clip(image, 0, 1)).astype(np.uint8)
    file = BytesIO()
    Image.fromarray(levels).save(file, "JPEG", quality=quality, subsampling=0)
    return "data:image/jpeg;base64," + base64.b64encode(file.getvalue()).decode()
