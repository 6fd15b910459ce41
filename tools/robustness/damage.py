"""Damage to the bytes of any file, drawn from a generator of random numbers."""

import numpy as np

Rng = np.random.Generator


def cut(data: bytes, rng: Rng) -> bytes:
    """Return data that end too early."""
    return data[: int(rng.integers(len(data)))]


def flipped(data: bytes, rng: Rng, most: int, span: tuple[int, int] | None = None) -> bytes:
    """Return data with bits flipped in fewer than ``most`` bytes, anywhere or in a span."""
    changed = bytearray(data)
    for at in rng.integers(*(span or (0, len(data))), int(rng.integers(1, most))):
        changed[at] ^= int(rng.integers(1, 256))
    return bytes(changed)


def overwritten(data: bytes, rng: Rng, longest: int, *, zeros: bool = False) -> bytes:
    """Return data with noise, or half of the time zeros if they may be, over fewer than ``longest`` bytes."""
    start, count = int(rng.integers(0, len(data))), int(rng.integers(1, longest))
    length = len(data[start : start + count])
    noise = bytes(length) if zeros and rng.random() >= 0.5 else rng.bytes(length)
    return data[:start] + noise + data[start + length :]
