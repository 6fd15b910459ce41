"""Results of an earlier call that somebody has changed since, drawn from a generator of random numbers."""

import base64
import json
import os
import shutil
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from tools.robustness.damage import Rng, cut, flipped
from tools.robustness.hostile_files import no_picture

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
    """Change one of the results in a folder: its values, its bytes, what it is."""
    results = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.suffix != ".jpg"]
    results = [path for path in results if not path.name.startswith(".") and path.stat().st_size]
    manifests = [path for path in results if path.suffix == ".jsonl"]
    among = manifests if rng.random() < 0.6 else results
    kind, path = int(rng.integers(8)), among[int(rng.integers(len(among)))]
    if kind == 7:
        _place(path, rng)
        return
    data = path.read_bytes()
    match kind:
        case 3:
            data = _text(data, rng)
        case 5:
            data = cut(data, rng)
        case 6:
            data = no_picture(rng)
        case 0 | 1 | 2 if path.suffix in (".json", ".jsonl"):
            data = _value(data, rng, by_line=path.suffix == ".jsonl")
        case _:
            data = flipped(data, rng, 20)
    path.write_bytes(data)


def _value(data: bytes, rng: Rng, *, by_line: bool) -> bytes:
    """Return a JSON document, or lines of them, with odd values anywhere."""
    lines = data.decode().splitlines() if by_line else [data.decode()]
    number = int(rng.integers(len(lines)))
    value = json.loads(lines[number])
    for _ in range(int(rng.integers(1, 3))):
        _put(value, rng)
    lines[number] = json.dumps(value)
    return ("\n".join(lines) + "\n").encode()


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


def _text(data: bytes, rng: Rng) -> bytes:
    """Return data with a text that JSON's readers stumble over in place of a value."""
    at = data.find(b": ", int(rng.integers(len(data)))) + 2
    return data[:at] + TEXTS[int(rng.integers(len(TEXTS)))].encode() + data[at + 5 :]


def _place(path: Path, rng: Rng) -> None:
    path.unlink()
    if rng.random() < 0.3:
        os.mkfifo(path)
    elif rng.random() < 0.1:
        path.mkdir()
    else:
        path.symlink_to(str(rng.choice(PLACES)))


def spoiled(folder: Path, words: tuple[str, ...], *, seed: tuple[int, ...]) -> None:
    """Put the results of an earlier call into the folder of one, and spoil one of them."""
    shutil.copytree(earlier(folder.parent, words), folder, dirs_exist_ok=True, symlinks=True)
    for name in (".stdout", ".stderr"):
        (folder / name).unlink()
    spoil(folder, np.random.default_rng(seed))


def earlier(place: Path, words: tuple[str, ...]) -> Path:
    """Return the folder in which a command was called before."""
    return place / f"earlier-{'-'.join(words).replace('/', '_')}"
