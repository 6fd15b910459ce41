"""Damage to any file: its bytes, or what stands in its place, drawn from a generator of random numbers."""

import os
import re
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

Rng = np.random.Generator
T = TypeVar("T")
TOKEN = re.compile(rb'"[^"\n]*"|[\w.+-]+')
TOKENS = (
    b"", b"-1", b"0", b"3", b"0.5", b"nan", b"NaN", b"inf", b"1e999", b"-Infinity", b"5e-324", b"9" * 6000,
    b"4611686018427387904", b"0x10", b"1_0", b"null", b"{}", b'""', b'"', b"[" * 200_000, b'{"a":' * 5000,
    b'"\\ud800"', b"\0", b"\n", b"\x1b[2J", b"\xff\xfe", b"\xc3\xbc", b"\xe2\x80\xae", b"x" * 99_999, b"..",
    b"../../x", b"/dev/zero", b"/etc/passwd", b"good.jpg", b"@list.txt", b"-", b"--", b"#", b"%s", b"PINHOLE",
    b"FULL_OPENCV", b"EQUIRECTANGULAR", b"cposix\nsystem\n(S'touch RAN'\ntR.",  # a pickle that runs
)  # fmt: skip
INTEGERS, REALS = (0, 1, 255, 2**16, 2**31 - 1, 2**31, 2**32 - 1), (0.0, -1.0, 1e300, 1e-300, np.nan, np.inf)
NUMBERS = [struct.pack(f"{order}I", number) for order in "<>" for number in INTEGERS]
NUMBERS += [struct.pack(f"{order}d", number) for order in "<>" for number in REALS] + [b"\xff" * 8]
OTHERS = (
    b"", b"photograph\n" * 99, b"PK\3\4" + bytes(99), b"SQLite format 3\0" * 9, b"<html></html>", bytes(4096),
    b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n", b"II*\0", b"%PDF-1.7\n", b"RIFF\0\0\0\0WEBP", b"{}", b"[]", b"1",
    b"<svg xmlns='http://www.w3.org/2000/svg' width='99' height='99'/>", bytes(range(256)) * 20,
)  # fmt: skip
PLACES = ("/dev/zero", "/dev/random", "/dev/null", "/proc/self/mem", "/", "nowhere")


def drawn(rng: Rng, choices: Sequence[T]) -> T:
    """Return one of several things, each as likely."""
    return choices[int(rng.integers(len(choices)))]


def _at(data: bytes, rng: Rng) -> int:
    """Return a place in data: anywhere, or near an end, where a format says what the rest is."""
    near = int(len(data) ** rng.random()) - 1
    return drawn(rng, (int(rng.integers(len(data))), near, near, len(data) - 1 - near))


def _flipped(data: bytes, rng: Rng) -> bytes:
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 20))):
        changed[_at(data, rng)] ^= int(rng.integers(1, 256))
    return bytes(changed)


def _token(data: bytes, rng: Rng) -> bytes:
    found = TOKEN.search(data, _at(data, rng)) or TOKEN.search(data)
    return data[: found.start()] + drawn(rng, TOKENS) + data[found.end() :] if found else data


def _over(data: bytes, rng: Rng) -> bytes:
    """Return data with noise, zeros or a number over a part."""
    noise = rng.bytes(int(rng.integers(1, 3000)))
    at, new = _at(data, rng), drawn(rng, (noise, bytes(len(noise)), *[drawn(rng, NUMBERS)] * 6))
    return data[:at] + new[: len(data) - at] + data[at + len(new) :]


MUTATIONS: tuple[Callable[[bytes, Rng], bytes], ...] = (  # of data that are not empty
    _flipped,
    _over,
    _token,
    lambda data, rng: data[: _at(data, rng)],
    lambda data, rng: data[: _at(data, rng)] + data[_at(data, rng) :],  # a part less, or twice
    lambda data, rng: drawn(rng, OTHERS),
)
SHARES = (0.2, 0.3, 0.3, 0.08, 0.08, 0.04)  # those that keep most of a file reach deepest into its reader


def mutated(data: bytes, rng: Rng) -> bytes:
    """Return data with one to three mutations."""
    for number in rng.choice(len(MUTATIONS), int(rng.integers(1, 4)), p=SHARES):
        data = MUTATIONS[number](data or b"\n", rng)
    return data


def damage(path: Path, rng: Rng) -> None:
    """Mutate a file, or put what is no file, or nothing, in its place."""
    data = path.read_bytes()
    path.unlink()
    match int(rng.integers(40)):
        case 0:
            path.mkdir()
        case 1:
            os.mkfifo(path)
        case 2 | 3:
            path.symlink_to(drawn(rng, (*PLACES, path.name)))
        case number if number > 4:
            path.write_bytes(mutated(data, rng))
