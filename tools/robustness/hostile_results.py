"""Results of an earlier call that somebody has changed since, drawn from a generator of random numbers."""

from __future__ import annotations

import base64
import json
import os
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tools.robustness.hostile_files import Rng, no_picture

RAN = "RAN"  # the file that a call would make if it ran what a result says
PICKLE = f"cposix\nsystem\n(S'touch {RAN}'\ntR.".encode()
PLACES = ("/dev/zero", "/dev/random", "/dev/null", "/proc/kmsg", "/proc/self/mem", "/", "nowhere")
VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1e300, 1 << 62, 1 << 70, 10**400, "", "\0", "\ud800", "\udcff", "\x1b[2J", "\n",
    "x" * 99_999, [], {}, [[]] * 999, "../../x", "/etc/passwd", "a\0b.jpg", "n" * 5000, {"posix": "system"},
    [1, "2", None, {}], PICKLE.decode(), base64.b85encode(zlib.compress(PICKLE)).decode(),
    base64.b85encode(zlib.compress(bytes(10**8), 9)).decode(),
)  # fmt: skip
TEXTS = ("[" * 200_000, '{"a":' * 5000 + "1" + "}" * 5000, "NaN", "1e999", "-Infinity", "", "}", "9" * 6000)


def spoil(folder: Path, rng: Rng) -> None:
    """Change one of the results in a folder: its bytes, its values, what it is."""
    results = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.suffix != ".jpg"]
    results = [path for path in results if not path.name.startswith(".") and path.stat().st_size]
    manifests = [path for path in results if path.suffix == ".jsonl"]
    chosen = manifests if rng.random() < 0.6 else results
    SPOILS[int(rng.integers(len(SPOILS)))](chosen[int(rng.integers(len(chosen)))], rng)


def _value(path: Path, rng: Rng) -> None:
    """Put an odd value anywhere into a JSON document or line; another file gets noise."""
    if path.suffix not in (".json", ".jsonl"):
        _bytes(path, rng)
        return
    lines = path.read_text().splitlines() if path.suffix == ".jsonl" else [path.read_text()]
    number = int(rng.integers(len(lines)))
    value = json.loads(lines[number])
    for _ in range(int(rng.integers(1, 3))):
        _put(value, rng)
    lines[number] = json.dumps(value)
    path.write_text("\n".join(lines) + "\n")


def _put(value: Any, rng: Rng) -> None:
    """Change one part of a list or object, at any depth."""
    while True:
        keys = list(value) if isinstance(value, dict) else list(range(len(value)))
        if not keys:
            return
        key = keys[int(rng.integers(len(keys)))]
        if isinstance(value[key], list | dict) and value[key] and rng.random() < 0.7:
            value = value[key]
            continue
        odd = VALUES[int(rng.integers(len(VALUES)))]
        kind = rng.random()
        if isinstance(value, dict) and kind < 0.15:
            del value[key]
        elif isinstance(value, dict) and kind < 0.3:
            value[str(odd)[:50]] = odd
        else:
            value[key] = odd
        return


def _text(path: Path, rng: Rng) -> None:
    """Put a text that JSON's readers stumble over in place of a value."""
    text = path.read_bytes()
    at = text.find(b": ", int(rng.integers(len(text)))) + 2
    path.write_bytes(text[:at] + TEXTS[int(rng.integers(len(TEXTS)))].encode() + text[at + 5 :])


def _bytes(path: Path, rng: Rng) -> None:
    """Flip bits anywhere."""
    data = bytearray(path.read_bytes())
    for at in rng.integers(0, len(data), int(rng.integers(1, 20))):
        data[at] ^= int(rng.integers(1, 256))
    path.write_bytes(data)


def _cut(path: Path, rng: Rng) -> None:
    """Cut a file anywhere."""
    data = path.read_bytes()
    path.write_bytes(data[: int(rng.integers(len(data)))])


def _other(path: Path, rng: Rng) -> None:
    """Put something else there."""
    path.write_bytes(no_picture(rng))


def _place(path: Path, rng: Rng) -> None:
    """Put there what is no regular file."""
    path.unlink()
    if rng.random() < 0.3:
        os.mkfifo(path)
    elif rng.random() < 0.1:
        path.mkdir()
    else:
        path.symlink_to(str(rng.choice(PLACES)))


SPOILS: tuple[Callable[[Path, Rng], None], ...] = (
    _value,
    _value,
    _value,
    _text,
    _bytes,
    _cut,
    _other,
    _place,
)


def spoiled(folder: Path, words: tuple[str, ...], *, seed: tuple[int, ...]) -> None:
    """Put the results of an earlier call into the folder of one, and spoil one of them."""
    shutil.copytree(earlier(folder.parent, words), folder, dirs_exist_ok=True, symlinks=True)
    for name in (".stdout", ".stderr"):
        (folder / name).unlink()
    spoil(folder, np.random.default_rng(seed))


def earlier(place: Path, words: tuple[str, ...]) -> Path:
    """Return the folder in which a command was called before."""
    return place / f"earlier-{'-'.join(words).replace('/', '_')}"
