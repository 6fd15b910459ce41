"""Packing: what the page unpacks is what was packed, to half a step, and small."""

import base64
import zlib
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from blur2view.results.report_pack import packed


def unpacked(packed: dict[str, Any]) -> NDArray[np.float64]:
    """Decode `report_pack.packed`, written from its description with Python's integers."""
    planes = zlib.decompress(base64.b64decode(packed["data"]))
    bits = int(packed["type"].lstrip("uint"))
    signed, octets = packed["type"].startswith("i"), bits // 8
    shape = packed["shape"]
    count = len(planes) // octets
    values, total = [], 0
    for index in range(count):
        delta = sum(planes[plane * count + index] << (8 * plane) for plane in range(octets))
        total = (delta if index % shape[-1] == 0 else total + delta) % 2**bits
        values.append(total - 2**bits if signed and total >= 2 ** (bits - 1) else total)
    step: float = packed["step"]
    return np.array(values, float).reshape(shape) * step


@pytest.mark.parametrize("kind", ["uint8", "int16", "uint16", "int32"])
@pytest.mark.parametrize("shape", [(1,), (7,), (3, 5), (2, 3, 4), (4, 0)])
def test_integers_come_back_exactly(kind: str, shape: tuple[int, ...]) -> None:
    limits = np.iinfo(kind)
    values = np.random.default_rng(1).integers(limits.min, limits.max, shape, endpoint=True)
    back = packed(values, kind)
    assert back["step"] == 1 and back["type"] == kind
    np.testing.assert_array_equal(unpacked(back), values)


@pytest.mark.parametrize(("most", "step"), [(90.0, 1 / 64), (900.0, 1 / 32)])
def test_error_is_at_most_half_a_step_which_doubles_until_every_value_fits(most: float, step: float) -> None:
    values = np.random.default_rng(2).uniform(-most, most, (40, 50))
    back = packed(values, "int16", 1 / 64)
    assert back["step"] == step and abs(unpacked(back) - values).max() <= step / 2
