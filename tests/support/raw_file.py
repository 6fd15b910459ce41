"""A small RAW file: a DNG of one 16-bit Bayer plane, as the DNG specification 1.4 has it at least."""

import struct

import numpy as np
from numpy.typing import NDArray

SHORT, LONG, BYTE, ASCII, RATIONAL = 3, 4, 1, 2, 5


def dng(plane: NDArray[np.uint16], orientation: int = 1) -> bytes:
    """Return a DNG of a plane (H, W) of red, green, green and blue pixels in rows RG and GB."""
    height, width = plane.shape
    matrix = [(1, 1), (0, 1), (0, 1), (0, 1), (1, 1), (0, 1), (0, 1), (0, 1), (1, 1)]
    tags: list[tuple[int, int, list[int] | bytes | list[tuple[int, int]]]] = [
        (254, LONG, [0]), (256, LONG, [width]), (257, LONG, [height]), (258, SHORT, [16]), (259, SHORT, [1]),
        (262, SHORT, [32803]), (271, ASCII, b"Test\0"), (272, ASCII, b"Camera\0"), (273, LONG, [0]),
        (274, SHORT, [orientation]), (277, SHORT, [1]), (278, LONG, [height]), (279, LONG, [plane.nbytes]),
        (284, SHORT, [1]), (33421, SHORT, [2, 2]), (33422, BYTE, bytes([0, 1, 1, 2])),
        (50706, BYTE, bytes([1, 4, 0, 0])), (50707, BYTE, bytes([1, 1, 0, 0])),
        (50708, ASCII, b"Test Camera\0"), (50714, SHORT, [0]), (50717, LONG, [65535]),
        (50721, 10, matrix), (50728, RATIONAL, [(1, 1), (1, 1), (1, 1)]), (50778, SHORT, [21]),
    ]  # fmt: skip
    extra_at = 8 + 2 + 12 * len(tags) + 4
    extra = b""
    packed = []
    for tag, kind, values in tags:
        content = _content(kind, values)
        count = len(content) // {SHORT: 2, LONG: 4, BYTE: 1, ASCII: 1, RATIONAL: 8, 10: 8}[kind]
        if len(content) > 4:
            packed.append([tag, kind, count, struct.pack("<I", extra_at + len(extra))])
            extra += content + b"\0" * (len(content) % 2)
        else:
            packed.append([tag, kind, count, content.ljust(4, b"\0")])
    for entry in packed:
        if entry[0] == 273:
            entry[3] = struct.pack("<I", extra_at + len(extra))
    directory = struct.pack("<H", len(tags)) + b"".join(struct.pack("<HHI4s", *entry) for entry in packed)
    return b"II*\0" + struct.pack("<I", 8) + directory + bytes(4) + extra + plane.astype("<u2").tobytes()


def _content(kind: int, values: list[int] | bytes | list[tuple[int, int]]) -> bytes:
    """Return the bytes of a tag's values."""
    if isinstance(values, bytes):
        return values
    numbers = [number for value in values for number in (value if isinstance(value, tuple) else (value,))]
    return struct.pack(f"<{len(numbers)}{'H' if kind == SHORT else 'i' if kind == 10 else 'I'}", *numbers)
