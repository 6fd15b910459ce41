"""All frames that a model lacks: one process or several recover them, and each result is noted."""

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import fields
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from blur2view import __version__
from blur2view.arrays import Array
from blur2view.colmap.frame_sequence import FrameSequence, RecoveredFrame
from blur2view.errors import OutputError, RunError
from blur2view.files import file_digest
from blur2view.networks.smear_network import SmearNetwork, SmearReader
from blur2view.output import (
    add_checked_line,
    checked_line,
    checked_lines,
    is_ours,
    signed,
    unwritable,
    write_file,
)
from blur2view.processes import not_started, processes, spawn_context

SMEAR = "smear_px"  # key of a line that has it
Result: TypeAlias = RecoveredFrame | str
"""A recovered frame, or the reason for which it is refused."""
OfEach = Callable[[Callable[[FrameSequence, str], Any], Sequence[str]], Iterator[Any]]
"""Yields what a method of a sequence returns of frames, in order."""
Show = Callable[[int, int], None]
"""Gets how many parts of a step are done, of how many."""


class Notes:
    """A file of results, one frame a line, so that a call that was interrupted goes on where it stopped.

    The first line says of which call and which version of the program they are; what was damaged since is
    done again. ``smears`` are those that are read where ``max_smear_px`` sets frames aside, pixels.
    OutputError if the file is somebody else's.
    """

    def __init__(self, path: Path, sequence: FrameSequence, max_smear_px: float | None = None) -> None:
        self.path, self.first = path, _first_line(sequence, max_smear_px)
        self.results, self.smears = dict[str, Result](), dict[str, float]()
        if os.path.lexists(path) and not is_ours(path):
            raise OutputError(f"{path}: already exists and was not written by blur2view; name another")
        lines = checked_lines(path)
        ours = lines[:1] == [self.first]
        for values in map(json.loads, lines[1:] if ours else ()):
            name = values.pop("name")
            if SMEAR in values:
                self.smears[name] = values[SMEAR]
            else:
                self.results[name] = _read_result(values)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(path.parent, error) from None
        content = "".join(map(checked_line, lines if ours else [self.first]))
        write_file(path, content.encode())  # whole or not at all, so that no result is lost on the way

    def add(self, name: str, result: Result) -> None:
        """Note a frame's result."""
        self.results[name] = result
        add_checked_line(self.path, _line(name, result))

    def add_smear(self, name: str, smear_px: float) -> None:
        """Note the length of a frame's smears."""
        self.smears[name] = smear_px
        add_checked_line(self.path, json.dumps({"name": name, SMEAR: smear_px}))

    def remove(self) -> None:
        """Remove the file, and its folder if nothing else is there."""
        self.path.unlink(missing_ok=True)
        with suppress(OSError):
            self.path.parent.rmdir()


def set_aside_blurred(
    sequence: FrameSequence,
    max_smear_px: float,
    *,
    jobs: int = 1,
    notes: Notes | None = None,
    show: Show = lambda done, count: None,
) -> None:
    """Set aside the registered frames whose smears, median at their points, are longer, and misplaced ones.

    DatabaseError if fewer than two are left.
    """
    names, smears = sequence.alone(), dict[str, float]() if notes is None else notes.smears
    missing = [name for name in names if name not in smears]
    read = dict(smears)
    with _processes(sequence, min(jobs, len(missing))) as of_each:
        show(len(names) - len(missing), len(names))
        for name, smear_px in zip(missing, of_each(FrameSequence.smear_px, missing), strict=True):
            read[name] = smear_px
            if notes is not None:
                notes.add_smear(name, smear_px)
            show(len(read), len(names))
    misplaced = sequence.misplaced()
    sequence.set_aside([name for name in names if name in misplaced or read[name] > max_smear_px])


def recover_all(
    sequence: FrameSequence,
    *,
    jobs: int = 1,
    notes: Notes | None = None,
    show: Show = lambda done, count: None,
) -> None:
    """Recover the frames that a sequence's model lacks, or refuse them, and note both in the sequence.

    Frames that are equally far from registered ones are a round, and know the poses of the rounds before, so
    that any number of processes gives the same.
    """
    rounds, noted_results = sequence.rounds(), {} if notes is None else notes.results
    count, done = sum(map(len, rounds)), 0
    with _processes(sequence, min(jobs, count - len(noted_results))) as of_each:
        for names in rounds:
            missing = [name for name in names if name not in noted_results]
            for name in names:
                if name in noted_results:
                    sequence.note(name, noted_results[name])
            done += len(names) - len(missing)
            show(done, count)
            for name, result in zip(missing, of_each(FrameSequence.try_frame, missing), strict=True):
                sequence.note(name, result)
                if notes is not None:
                    notes.add(name, result)
                done += 1
                show(done, count)
            sequence.poses |= {
                name: sequence.recovered[name].pose for name in names if name in sequence.recovered
            }


@contextmanager
def _processes(sequence: FrameSequence, count: int) -> Iterator[OfEach]:
    """Yield what works on frames: this process, or several that end with the block, also by Ctrl-C."""
    if count < 2:
        yield lambda work, names: (work(sequence, name) for name in names)
        return
    network, (stop, end) = sequence.network, spawn_context().Pipe(duplex=False)
    reader = network.path if isinstance(network, SmearNetwork) else network
    prepare_args = sequence.source, sequence.folder, list(sequence.times), reader, list(sequence.aside)
    pool = processes(count, _prepare, prepare_args, stop=stop)

    def of_each(work: Callable[[FrameSequence, str], Any], names: Sequence[str]) -> Iterator[Any]:
        poses = dict(sequence.poses)
        try:
            pending = [pool.submit(_of_one, work, name, poses) for name in names]
        except OSError as error:
            raise not_started(error) from None
        for future in pending:
            yield future.result()

    try:
        yield of_each
    except BrokenProcessPool:
        raise RunError("a process died, perhaps because of too little memory; add --jobs 1") from None
    finally:
        end.close()
        pool.shutdown(wait=False, cancel_futures=True)  # by its own thread: `Future.cancel` would break that


_SEQUENCE: list[FrameSequence] = []  # of a process that was started


def _prepare(
    model: Path, frames: Path, names: Sequence[str], network: SmearReader | Path, aside: Sequence[str]
) -> None:
    """Prepare a process."""
    reader = SmearNetwork(network, threads=1) if isinstance(network, Path) else network
    _SEQUENCE[:] = [FrameSequence(model, frames, names, reader)]
    _SEQUENCE[0].set_aside(aside)


def _of_one(work: Callable[[FrameSequence, str], Any], name: str, poses: Mapping[str, Array]) -> Any:
    """Return what a method returns of a frame, by the poses of all that are known."""
    (sequence,) = _SEQUENCE
    sequence.poses = dict(poses)
    return work(sequence, name)


def _first_line(sequence: FrameSequence, max_smear_px: float | None) -> str:
    """Return the line that stands for a call: its model, frames, network and version."""
    model = {path.name: file_digest(path) for path in sorted(sequence.source.iterdir()) if path.is_file()}
    states = [(sequence.folder / name).stat() for name in sequence.times if (sequence.folder / name).exists()]
    frames = list(sequence.times), [(state.st_size, state.st_mtime_ns) for state in states]
    network = getattr(sequence.network, "model_id", "")
    call = sha256(
        repr((model, frames, network, max_smear_px, __version__)).encode("utf-8", "surrogateescape")
    ).hexdigest()
    return json.dumps(signed({"call_sha256": call}, "recover"))


def _line(name: str, result: Result) -> str:
    """Return a result as JSON."""
    if isinstance(result, str):
        return json.dumps({"name": name, "refused": result})
    values = {one.name: np.asarray(getattr(result, one.name)).tolist() for one in fields(result)}
    return json.dumps({"name": name, **values})


def _read_result(values: dict[str, Any]) -> Result:
    """Return the result of a line's values."""
    if "refused" in values:
        return str(values["refused"])
    points, residual = np.array(values.pop("points"), int), values.pop("residual_px")
    arrays = {key: np.array(value, float) for key, value in values.items()}
    return RecoveredFrame(points=points, residual_px=residual, **arrays)
