"""The manifest: JSON lines that say what is done, appended as it is done, so that a later call goes on.

A line is written by one call of the system and forced to the disk, with a digest of itself: one that was cut
off or changed is passed over. A line of ``"options"`` says what results depend on, the others hold the
digests and the row of a photograph that is done, or the digest of a file of all photographs. It lies hidden
beside its output, or in it if that is a folder. One call at a time has a manifest.
"""

import errno
import fcntl
import hashlib
import json
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from blur2view.errors import OutputError
from blur2view.images.video import frame_of
from blur2view.input_files import open_regular, parse_json, read_regular
from blur2view.output_files import unwritable
from blur2view.results.table import Row
from blur2view.runs.job import Job, Outcome, file_digest, photograph_digest

SIGN, FORMAT = "blur2view", 5  # 1 held pickles, 2 summaries, 3 no digests of lines, 4 pointers
HEAD = f'{{"{SIGN}": '.encode()  # how every manifest begins
ENDING = ".manifest.jsonl"
NO_LOCKS = {errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS}  # of file systems that have none
DAMAGE = (ValueError, TypeError, LookupError, AttributeError)
"""What reading a line may raise that is none of ours."""
Line = dict[str, Any]


class Manifest:
    """The lines of a manifest by photograph, and the file that new ones are appended to.

    A photograph is known by its path from the manifest's folder, from wherever it is named; what earlier
    calls of the same ``head`` did with it is looked up with ``resume``, also in the manifests of other
    outputs in these ``folders``.
    """

    def __init__(self, path: Path, file: int, head: Line, folders: Iterable[Path], resume: bool) -> None:
        self.path, self._file, self._head = path, file, head
        self._settings = _digest_of(head)  # which every line repeats
        self._done: dict[str, Line] = {}
        self._owners: dict[str, tuple[str, str]] = {}
        self._targets: dict[str, str] = {}
        self._heads: dict[str, Line] = {}
        self._digests: dict[Path, str] = {}
        for other in sorted({one for folder in folders for one in folder.glob(f".*{ENDING}")} - {path}):
            with suppress(OSError, OutputError):
                self._read(other)
        self._headed, self._damaged = False, False
        self._end = self._read(path)
        if not resume:
            self._done, self._heads = {}, {}

    @property
    def complaint(self) -> OutputError | None:
        """Return one line about what cannot be gone on with, if there is such."""
        if self._heads and self._settings not in self._heads:
            *_, head = self._heads.values()
            then, now = head["options"], self._head["options"]
            changed = ", ".join(sorted(name for name in {**then, **now} if then.get(name) != now.get(name)))
            if (head[SIGN], head.get("format")) != (self._head[SIGN], FORMAT):
                return OutputError(f"{self.path}: is of another version of blur2view; all is done again")
            return OutputError(f"{self.path}: other options ({changed}) made it; all is done again")
        if self._damaged:
            return OutputError(f"{self.path}: a line was cut off or changed; that photograph is done again")
        return None

    def other_owner(self, path: Path, outputs: Iterable[Path]) -> str | None:
        """Return the other photograph of which one of these files is a result, from the manifest's folder.

        The same one by another name, as after the manifest's folder was moved, is no other.
        """
        for output in outputs:
            owner, digest = self._owners.get(self._name(output), ("", ""))
            if owner not in ("", self._name(path)) and os.path.lexists(output) and _digest(path) != digest:
                return owner
        return None

    def find(self, job: Job) -> Outcome | None:
        """Return what an earlier call made of a photograph, if it is the same and its files are whole.

        The payload is the photograph's document, if it has files, or what the manifest holds.
        """
        line = self._done.pop(self._name(job.path), None)  # which may be large
        if line is None or (line["sha256"], line["source"]) != (_digest(job.path), self._source(job)):
            return None
        whole = (_digest(self.path.parent / name) == digest for name, digest in line["outputs"].items())
        if set(map(self._name, job.files)) != line["outputs"].keys() or not all(whole):
            return None  # its results have other names since then, or another content
        with suppress(OSError, *DAMAGE):
            payload = parse_json(read_regular(job.files[-1])) if job.files else line["kept"]
            done = f"{job.path}: done before"
            return Outcome(payload=payload, summary=done, row=Row(**line["row"]), skipped=True)
        return None

    def wrote(self, target: Path) -> bool:
        """Return whether a file of all photographs is as an earlier call left it."""
        return _digest(target) == self._targets.get(self._name(target), "")

    def append(self, job: Job, outcome: Outcome) -> None:
        """Append the line of a photograph that is done; OutputError if it cannot be."""
        line: Line = {"settings": self._settings, "image": self._name(job.path)}
        line |= {"sha256": outcome.digest, "source": self._source(job)}
        line["outputs"] = {self._name(path): digest for path, digest in outcome.outputs.items()}
        self._write(line | {"row": asdict(outcome.row), "kept": None if job.files else outcome.payload})

    def append_target(self, target: Path) -> None:
        """Append the digest of a file of all photographs, which has been written."""
        self._write({"target": self._name(target), "sha256": file_digest(target)})

    def _source(self, job: Job) -> str:
        """Return what a result depends on besides its photograph: its neighbours, a video as a whole."""
        for path in {one.path for one in job.neighbours} - self._digests.keys():
            self._digests[path] = "" if frame_of(path) else _digest(path) or ""
        return job.source + " ".join(f"{one.steps:+d}{self._digests[one.path]}" for one in job.neighbours)

    def _name(self, path: Path) -> str:
        return Path(os.path.relpath(path, self.path.parent)).as_posix()

    def _read(self, path: Path) -> int:
        """Note the lines of earlier calls; return where the last whole one ends."""
        end = 0
        with open_regular(path) as file:
            if not HEAD.startswith(file.read(len(HEAD))):
                raise _foreign(path)
            file.seek(0)
            for text in file:
                end += len(text) * text.endswith(b"\n")
                try:
                    line = parse_json(text)
                    if SIGN not in line and line.pop("digest") != _digest_of(line):
                        raise ValueError("another one wrote it, or a part of it")
                    self._note(line, path.parent)
                except DAMAGE:
                    self._damaged = True
        return end

    def _note(self, line: Line, folder: Path) -> None:
        """Note a file of all photographs, or what was done with these settings, as seen from a folder."""
        if SIGN in line:
            self._heads[line["settings"]] = line | {"options": dict(line["options"])}
        elif "target" in line:
            self._targets[self._name(folder / line["target"])] = line["sha256"]
        elif "outputs" in line:
            image = self._name(folder / line["image"])
            line["outputs"] = {self._name(folder / one): digest for one, digest in line["outputs"].items()}
            self._owners |= dict.fromkeys(line["outputs"], (image, line["sha256"]))
            self._done.pop(image, None)  # done otherwise since
            if line["settings"] == self._settings:
                self._done[image] = line

    def _write(self, line: Line) -> None:
        """Append a line and wait until the disk has it."""
        head = [] if self._headed else [self._head | {"settings": self._settings}]
        lines = [*head, line | {"digest": _digest_of(line)}]
        content = "".join(json.dumps(one) + "\n" for one in lines).encode()
        try:
            if not self._headed:
                os.ftruncate(self._file, self._end)  # without what was cut off
            while content:
                content = content[os.write(self._file, content) :]
            os.fsync(self._file)
        except OSError as error:
            raise OutputError(
                f"{self.path}: cannot be written ({error.strerror}); make room and go on with --resume"
            ) from None
        self._headed = True


@contextmanager
def opened(
    path: Path,
    *,
    command: str,
    version: str,
    options: Mapping[str, Any],
    resume: bool,
    folders: Iterable[Path] = (),
) -> Iterator[Manifest]:
    """Open the manifest at a path, which no other call has then; at the end remove one that stays empty.

    ``options``, of JSON's types, are all that results depend on beside their photograph, digests of networks
    and other files among them. OutputError if there is a file of another kind, one that cannot be read or
    written, or one of a call that runs.
    """
    new, file = not os.path.lexists(path), _open_alone(path)
    try:
        head = {SIGN: version, "format": FORMAT, "command": command, "options": dict(options)}
        yield Manifest(path, file, head, folders, resume)
    finally:
        if new and not os.fstat(file).st_size:
            path.unlink(missing_ok=True)
        os.close(file)


def _open_alone(path: Path) -> int:
    """Return the descriptor of a regular file, open to append to and locked: no other call has it."""
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NONBLOCK, 0o666)
    except OSError as error:
        raise unwritable(path, error) from None
    try:
        regular = stat.S_ISREG(os.fstat(file).st_mode)
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(file)
        raise OutputError(f"{path}: another call writes there; wait for its end or write elsewhere") from None
    except OSError as error:
        regular = error.errno in NO_LOCKS
    if not regular:
        os.close(file)
        raise _foreign(path)
    return file


def _foreign(path: Path) -> OutputError:
    return OutputError(f"{path}: is no manifest of blur2view; rename or remove it")


def _digest_of(value: Any) -> str:
    """Return a digest of what JSON holds."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:16]


def _digest(path: Path) -> str | None:
    """Return the SHA-256 of a file; None of what cannot be read."""
    try:
        return photograph_digest(path)
    except (OSError, ValueError):  # of a name with a null character
        return None
