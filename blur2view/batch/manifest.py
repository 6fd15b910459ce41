"""The manifest: JSON lines that say what is done, appended as it is done, so that a later call goes on.

A line is written by one call of the system and forced to the disk; one that was cut off is dropped when the
manifest is opened again. A line of ``"options"`` says what results depend on, the others are of a photograph
each, done or failed, or of a file of all photographs.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import io
import json
import os
import pickle
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, ClassVar

from blur2view.batch.job import Job, Made, Outcome, file_digest
from blur2view.errors import OutputError
from blur2view.output_files import ResultFiles, unwritable

SIGN = "blur2view"
HEAD = f'{{"{SIGN}": '.encode()  # how every manifest begins
ARRAYS = {  # what NumPy's arrays are pickled with
    ("numpy", "dtype"),
    ("numpy", "ndarray"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("numpy._core.numeric", "_frombuffer"),
}


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What results depend on beside their photograph.

    Parameters
    ----------
    command : str
    version : str
        Of blur2view.
    options : mapping
        Of JSON's types.
    files : mapping of str to str
        SHA-256 of networks and other files that are read.
    """

    command: str
    version: str
    options: Mapping[str, Any]
    files: Mapping[str, str]

    @property
    def line(self) -> dict[str, Any]:
        """Return the line of a manifest."""
        facts = {"command": self.command, "options": dict(self.options), "files": dict(self.files)}
        return {SIGN: self.version, "settings": self.digest, **facts}

    @property
    def digest(self) -> str:
        """Return a name of these settings, which every line repeats."""
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()[:16]


class Manifest:
    """The lines of a manifest by photograph, and the file that new ones are appended to.

    A photograph is known by its path from the manifest's folder, from wherever it is named.

    Parameters
    ----------
    path : Path
        The file, which appears with the first line.
    settings : Settings
        Of this call.
    resume : bool
        Whether what earlier calls did with photographs is looked up.

    Raises
    ------
    OutputError
        If there is a file of another kind, or one that cannot be read.
    """

    def __init__(self, path: Path, settings: Settings, *, resume: bool) -> None:
        self.path, self.settings = path, settings
        self._begun = False
        self.cut_off = False
        self._done: dict[str, dict[str, Any]] = {}
        self._owners: dict[str, tuple[str, str]] = {}
        self._targets: dict[str, str] = {}
        for line in self._read():
            self._look_up(line, resume=resume)

    def knows(self, job: Job[Any]) -> bool:
        """Return whether an earlier call with these settings did a photograph, whatever it was then."""
        return self._name(job.path) in self._done

    def other_owner(self, path: Path, outputs: Iterable[Path]) -> str | None:
        """Return the other photograph of which one of these files is a result, from the manifest's folder.

        The same photograph by another name, as after the manifest's folder was moved, is no other.
        """
        for output in outputs:
            owner, digest = self._owners.get(self._name(output), ("", ""))
            if owner in ("", self._name(path)) or not os.path.lexists(output):
                continue
            with contextlib.suppress(OSError):
                if file_digest(path) == digest:
                    continue
            return owner
        return None

    def _name(self, path: Path) -> str:
        """Return a path from the manifest's folder."""
        try:
            return Path(os.path.relpath(path, self.path.parent)).as_posix()
        except ValueError:  # on another drive
            return Path(os.path.abspath(path)).as_posix()

    def find(self, job: Job[Any], folder: Path) -> Made[Any] | None:
        """Return what an earlier call made of a photograph, if it is the same and its files are whole.

        Parameters
        ----------
        job : Job
            With its digest.
        folder : Path
            That the names of files are relative to.
        """
        line = self._done.pop(self._name(job.path), None)  # which may be large
        if line is None or (line["sha256"], line["source"]) != (job.digest, job.source):
            return None
        outputs = {folder / name: digest for name, digest in line["outputs"].items()}
        if isinstance(job.target, ResultFiles) and set(job.target.paths) != outputs.keys():
            return None  # its results have other names since then
        if not all(_is_whole(path, digest) for path, digest in outputs.items()):
            return None
        try:
            kept = _unpacked(line["kept"])
        except Exception:  # damaged bytes, or those of another version, raise errors of any type
            return None
        return Made(kept=kept, summary=line["summary"], row=line["row"])

    def wrote(self, target: Path) -> bool:
        """Return whether a file is as an earlier call left it."""
        return _is_whole(target, self._targets.get(target.name, ""))

    def has_target(self, target: Path) -> bool:
        """Return whether an earlier call wrote a file of this name."""
        return target.name in self._targets

    def append(self, job: Job[Any], outcome: Outcome[Any], folder: Path) -> None:
        """Append the line of a photograph that is done or failed.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        about = {"settings": self.settings.digest, "image": self._name(job.path)}
        if outcome.made is None:
            self._write({**about, "error": outcome.error})
            return
        outputs = {path.relative_to(folder).as_posix(): digest for path, digest in outcome.outputs.items()}
        self._write(
            {
                **about,
                "sha256": outcome.digest,
                "source": job.source,
                "outputs": outputs,
                "summary": outcome.made.summary,
                "row": outcome.made.row,
                "kept": _packed(outcome.made.kept),
            }
        )

    def append_target(self, target: Path) -> None:
        """Append that a call wrote a file of all photographs, such as a database."""
        self._write({"target": target.name, "sha256": file_digest(target)})

    def _read(self) -> list[dict[str, Any]]:
        """Return the lines of earlier calls; one that was cut off is dropped."""
        try:
            content = self.path.read_bytes()
        except FileNotFoundError:
            return []
        except OSError as error:
            raise unwritable(self.path, error) from None
        whole = content[: content.rfind(b"\n") + 1]
        self.cut_off = whole != content
        lines = []
        for text in whole.splitlines():
            try:
                line = json.loads(text)
            except (ValueError, RecursionError):
                line = None
            if isinstance(line, dict) and _is_whole_line(line):
                lines.append(line)
            else:
                self.cut_off = True
        if content[: len(HEAD)] != HEAD[: len(content)]:
            raise OutputError(f"{self.path}: is no manifest of blur2view; rename or remove it")
        return lines

    def _look_up(self, line: dict[str, Any], *, resume: bool) -> None:
        """Note a file of all photographs, or what was done with these settings."""
        if "target" in line:
            self._targets[line["target"]] = line["sha256"]
            return
        owner = line.get("image", ""), line.get("sha256", "")
        self._owners |= dict.fromkeys(line.get("outputs", ()), owner)
        if resume and "outputs" in line and line.get("settings") == self.settings.digest:
            self._done[line["image"]] = line
        else:
            self._done.pop(line.get("image", ""), None)  # failed since, or done otherwise

    def _write(self, line: dict[str, Any]) -> None:
        """Append a line and wait until the disk has it."""
        lines = [line] if self._begun else [self.settings.line, line]
        content = "".join(json.dumps(line) + "\n" for line in lines).encode()
        try:
            file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
            try:
                _drop_cut_line(file)
                while content:
                    content = content[os.write(file, content) :]
                os.fsync(file)
            finally:
                os.close(file)
        except OSError as error:
            raise OutputError(
                f"{self.path}: cannot be written ({error.strerror}); make room and go on with --resume"
            ) from None
        self._begun = True


def _drop_cut_line(file: int) -> None:
    """Cut a file after its last whole line."""
    size = end = os.fstat(file).st_size
    while end and os.pread(file, 1, end - 1) != b"\n":
        end -= 1
    if end != size:
        os.ftruncate(file, end)


def _is_whole(path: Path, digest: str) -> bool:
    """Return whether a file has this content."""
    try:
        return file_digest(path) == digest
    except (OSError, ValueError):  # of a name with a null character
        return False


def _is_whole_line(line: dict[str, Any]) -> bool:
    """Return whether a line has all that its kind is read for."""
    of_target = {"target": str, "sha256": str}
    of_done = {"image": str, "sha256": str, "source": str, "outputs": dict, "summary": str, "kept": str}
    kind = of_target if "target" in line else of_done if "outputs" in line else {}
    row, image = line.get("row"), line.get("image", "")
    return (
        all(isinstance(line.get(name), type_) for name, type_ in kind.items())
        and isinstance(row, dict | None)
        and isinstance(image, str)
    )


def _packed(kept: object) -> str:
    """Return an object as text."""
    return base64.b85encode(zlib.compress(pickle.dumps(kept), 1)).decode()


def _unpacked(text: str) -> Any:
    """Return the object of a text; it is of our dataclasses, enums and arrays, or refused."""
    return _Unpickler(io.BytesIO(zlib.decompress(base64.b85decode(text)))).load()


class _Unpickler(pickle._Unpickler):
    """Reads objects of our own, as a manifest may be of anybody's: no other function is ever called.

    No class or member of an enum is changed, either: that would outlive the object. The reader in C has no
    place where that could be refused.
    """

    def find_class(self, module: str, name: str) -> Any:
        """Return a dataclass or an enum of this package, or what arrays need; refuse all else."""
        if (module, name) in ARRAYS or (module.partition(".")[0] == "pathlib" and name.endswith("Path")):
            return super().find_class(module, name)
        if module.partition(".")[0] == SIGN:
            found = super().find_class(module, name)
            if isinstance(found, type) and (is_dataclass(found) or issubclass(found, Enum)):
                return found
        raise pickle.UnpicklingError(f"{module}.{name} is none of ours")

    def load_build(self) -> None:
        """Give an object its state, unless that would set attributes of what others share."""
        instance, state = self.stack[-2:]  # type: ignore[attr-defined]
        by_attribute = isinstance(state, tuple) and not hasattr(instance, "__setstate__")
        if by_attribute or isinstance(instance, (type, Enum)):
            raise pickle.UnpicklingError(f"the state of a {type(instance).__name__} is none of ours")
        super().load_build()  # type: ignore[misc]

    dispatch: ClassVar[dict[int, Any]] = {**pickle._Unpickler.dispatch, pickle.BUILD[0]: load_build}
