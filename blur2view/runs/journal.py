"""What is done with photographs that get no files of their own: JSON lines, appended as they are done.

The lines lie hidden beside the output of all photographs. Each holds a photograph's record, with the digests
by which a later call knows it, and what else the command needs of it. A line that was cut off is passed over.
"""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from blur2view.errors import OutputError
from blur2view.input_files import open_regular, parse_json
from blur2view.output_files import unwritable

ENDING = ".blur2view.jsonl"
HEAD = b'{"blur2view": "'  # how every line begins
DAMAGE = (ValueError, TypeError, LookupError)  # what a line may raise that was cut off


class Journal:
    """The lines of a file, by their digests; new ones are appended and forced to the disk."""

    def __init__(self, path: Path, file: int) -> None:
        self.path, self._file = path, file
        self._lines = dict(self._read())
        if os.fstat(file).st_size and not self._ends_a_line():
            self._append(b"\n")

    def find(self, key: str) -> Mapping[str, Any] | None:
        """Return what was noted by a key last; None of nothing, or what cannot be read any more."""
        if key not in self._lines:
            return None
        start, length = self._lines[key]
        try:
            line: dict[str, Any] = parse_json(os.pread(self._file, length, start))
            return line if line["blur2view"] == key else None
        except DAMAGE:
            return None

    def note(self, key: str, content: Mapping[str, Any]) -> None:
        """Append what is to be found by a key; OutputError if it cannot be."""
        self._append((json.dumps({"blur2view": key, **content}, allow_nan=False) + "\n").encode())

    def _append(self, line: bytes) -> None:
        try:
            while line:
                line = line[os.write(self._file, line) :]
            os.fsync(self._file)
        except OSError as error:
            why = f"cannot be written ({error.strerror}); make room and go on with --resume"
            raise OutputError(f"{self.path}: {why}") from None

    def _read(self) -> Iterator[tuple[str, tuple[int, int]]]:
        """Yield the keys of the lines, with where these begin and how long they are."""
        start = 0
        with open_regular(self.path) as file:
            for line in file:
                key = line[len(HEAD) :].partition(b'"')[0]
                if line.endswith(b"\n"):
                    yield key.decode("ascii", "replace"), (start, len(line))
                start += len(line)

    def _ends_a_line(self) -> bool:
        return os.pread(self._file, 1, os.fstat(self._file).st_size - 1) == b"\n"


@contextmanager
def journal_beside(output: Path, *, resume: bool) -> Iterator[Journal]:
    """Open the journal of an output, empty unless a call is to ``resume``; one that stays empty is removed.

    OutputError if it cannot be written, or is no journal.
    """
    absolute = Path(os.path.abspath(output))  # . has no name
    path = absolute.with_name(f".{absolute.name}{ENDING}")
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NONBLOCK | os.O_NOFOLLOW, 0o666)
    except OSError as error:
        raise unwritable(path, error) from None
    try:
        begin = os.pread(file, len(HEAD), 0)
        if begin and begin != HEAD:
            raise OutputError(f"{path}: is no journal of blur2view; rename or remove it")
        if not resume:
            os.ftruncate(file, 0)
        yield Journal(path, file)
    finally:
        if not os.fstat(file).st_size:
            path.unlink(missing_ok=True)
        os.close(file)
