"""What is hostile in each call of every command, drawn from one seed."""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from tools.robustness.damage import Rng
from tools.robustness.hostile_arguments import hostile_arguments
from tools.robustness.hostile_databases import LINKS, put_database
from tools.robustness.hostile_files import hostile_model, hostile_photograph
from tools.robustness.hostile_lists import hostile_list, hostile_video
from tools.robustness.hostile_models import OF_MODELS, put_model
from tools.robustness.hostile_results import spoiled
from tools.robustness.politeness import EXTRACTED

BATCH = 8
GOOD, OTHER = "good.jpg", "other.jpg"
COMMANDS = (
    ("estimate", "-o", "out"),
    ("estimate", "--sequence", "--json"),
    ("estimate", "--jsonl"),
    ("segment", "--masks", "colmap", "-o", "out"),
    ("report", "-o", "page.html"),
    ("to-colmap", "--db", "new.db"),
    ("triage", "--csv", "table.csv", "--keep", "keep.txt"),
    ("triage", "--csv", "table.csv", "--best", "50%", "--extract", EXTRACTED),
)
RESUMED = tuple(words for words in COMMANDS if words[-1] not in ("--json", "--jsonl"))
SHARES = {
    "photographs": 0.36,
    "lists": 0.06,
    "videos": 0.05,
    "networks": 0.06,
    "full disks": 0.04,
    "standard input": 0.05,
    "databases": 0.12,
    "models": 0.08,
    "earlier results": 0.12,
}
"""Of all inputs; the others are arguments."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """What is hostile in one call: options, photographs beside the good one, a limit on file sizes.

    ``named`` are words for photographs, of which nobody knows how many they are; ``stdin`` is read as
    standard input; ``prepare`` puts files into the folder of a call of ``commands``.
    """

    kind: str
    words: list[str] = field(default_factory=list)
    photographs: list[Path] = field(default_factory=list)
    named: list[str] = field(default_factory=list)
    largest_file: int | None = None
    stdin: Path = Path(os.devnull)
    commands: tuple[tuple[str, ...], ...] = COMMANDS
    prepare: Callable[[Path, tuple[str, ...]], None] | None = None


def make_cases(folder: Path, count: int, seed: int) -> list[Case]:
    """Return cases of ``count`` hostile inputs; every kind has a stream of random numbers of its own."""
    shares = {kind: round(share * count) for kind, share in SHARES.items()}
    shares["arguments"] = count - sum(shares.values())

    def drawn(kind: str, stream: int) -> Iterator[tuple[int, Rng]]:
        return ((number, np.random.default_rng([seed, stream, number])) for number in range(shares[kind]))

    made = [hostile_photograph(folder, rng, number) for number, rng in drawn("photographs", 0)]
    cases = [
        Case(kind="photographs", photographs=made[start : start + BATCH])
        for start in range(0, len(made), BATCH)
    ]
    for number, rng in drawn("lists", 4):
        cases.append(Case(kind="lists", named=["--", *hostile_list(folder, rng, number, made)]))
    for number, rng in drawn("videos", 5):
        cases.append(Case(kind="videos", named=hostile_video(folder, rng, number)))
    for number, rng in drawn("networks", 1):
        cases.append(Case(kind="networks", words=["--model", str(hostile_model(folder, rng, number))]))
    for _, rng in drawn("full disks", 2):
        cases.append(Case(kind="full disks", largest_file=int(10 ** rng.uniform(3.6, 5.7))))
    for number, rng in drawn("standard input", 7):
        stream = _stream(folder, rng, number, made)
        cases.append(Case(kind="standard input", named=["--", "-"], stdin=stream))
    for number in range(shares["databases"]):
        prepare = partial(put_database, seed=(seed, 8, number))
        cases.append(Case(kind="databases", commands=LINKS, prepare=prepare))
    for number in range(shares["models"]):
        prepare = partial(put_model, seed=(seed, 10, number))
        cases.append(Case(kind="models", commands=OF_MODELS, prepare=prepare))
    for number in range(shares["earlier results"]):
        words, prepare = (
            ["--resume" if number % 4 else "--overwrite"],
            partial(spoiled, seed=(seed, 9, number)),
        )
        named = ["--", OTHER]
        cases.append(
            Case(kind="earlier results", words=words, named=named, commands=RESUMED, prepare=prepare)
        )
    cases += [Case(kind="arguments", words=hostile_arguments(rng)) for _, rng in drawn("arguments", 3)]
    order = np.random.default_rng([seed, 6]).permutation(len(cases))  # whoever stops has some of each
    return [cases[number] for number in order]


def _stream(folder: Path, rng: Rng, number: int, hostile: list[Path]) -> Path:
    """Return what a call reads as standard input: a list, or what never ends or is no list."""
    match number % 4:
        case 0:
            return Path(str(rng.choice(["/dev/zero", "/dev/random", "/dev/null", "/proc/self/mem"])))
        case 1:
            path = folder / f"stream{number}"
            line = [b"\n", b"\0", b"a\n", b"x" * 999_999, rng.bytes(999)][int(rng.integers(5))]
            path.write_bytes(line * (int(rng.choice([1, 1000, 20_000_000])) // len(line) + 1))
            return path
        case _:
            words = hostile_list(folder, rng, 100_000 + number, hostile)
            path = Path(words[-1].removeprefix("@"))
            return path if path.is_file() else Path(os.devnull)
