"""All frames that a model lacks: one process or several recover them, and each result is noted."""

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import fields
from hashlib import sha256
from pathlib import Path
from typing import TypeAlias

import numpy as np

from blur2view import __version__
from blur2view.arrays import Array
from blur2view.colmap.frame_sequence import FrameSequence, RecoveredFrame
from blur2view.errors import OutputError, RunError
from blur2view.files import (
    add_checked_line,
    checked_line,
    checked_lines,
    file_digest,
    is_ours,
    signed,
    unwritable,
    write_file,
)
from blur2view.networks.smear_network import SmearNetwork, SmearReader
from blur2view.processes import not_started, processes, spawn_context

Result: TypeAlias = RecoveredFrame | str
"""A recovered frame, or the reason for which it is refused."""
TryFrames = Callable[[Sequence[str], Mapping[str, Array]], Iterator[Result]]
"""Tries frames by the poses of all that are known, and yields their results in order."""


class Notes:
    """A file of results, one frame a line, so that a call that was interrupted goes on where it stopped.

    The first line says of which call and which version of the program they are; what was damaged since is
    done again. OutputError if the file is somebody else's.
    """

    def __init__(self, path: Path, sequence: FrameSequence) -> None:
        self.path, self.first, self.results = path, _first_line(sequence), dict[str, Result]()
        if os.path.lexists(path) and not is_ours(path):
            raise OutputError(f"{path}: already exists and was not written by blur2view; name another")
        lines = checked_lines(path)
        if lines[:1] == [self.first]:
            self.results = dict(_read_line(line) for line in lines[1:])
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(path.parent, error) from None
        content = "".join(map(checked_line, lines if self.results else [self.first]))
        write_file(path, content.encode())  # whole or not at all, so that no result is lost on the way

    def add(self, name: str, result: Result) -> None:
        """Note a frame's result."""
        self.results[name] = result
        add_checked_line(self.path, _line(name, result))

    def remove(self) -> None:
        """Remove the file, and its folder if nothing else is there."""
        self.path.unlink(missing_ok=True)
        with suppress(OSError):
            self.path.parent.rmdir()


def recover_all(
    sequence: FrameSequence,
    *,
    jobs: int = 1,
    notes: Notes | None = None,
    show: Callable[[int, int], None] = lambda done, count: None,
) -> None:
    """Recover the frames that a sequence's model lacks, or refuse them, and note both in the sequence.

    Frames that are equally far from registered ones are a round, and know the poses of the rounds before, so
    that any number of processes gives the same.
    """
    rounds, noted_results = sequence.rounds(), {} if notes is None else notes.results
    count, done = sum(map(len, rounds)), 0
    with _processes(sequence, min(jobs, count - len(noted_results))) as try_frames:
        for names in rounds:
            missing = [name for name in names if name not in noted_results]
            for name in names:
                if name in noted_results:
                    sequence.note(name, noted_results[name])
            done += len(names) - len(missing)
            show(done, count)
            for name, result in zip(missing, try_frames(missing, dict(sequence.poses)), strict=True):
                sequence.note(name, result)
                if notes is not None:
                    notes.add(name, result)
                done += 1
                show(done, count)
            sequence.poses |= {
                name: sequence.recovered[name].pose for name in names if name in sequence.recovered
            }


@contextmanager
def _processes(sequence: FrameSequence, count: int) -> Iterator[TryFrames]:
    """Yield what tries frames: this process, or several that end with the block, also by Ctrl-C."""
    if count < 2:
        yield lambda names, poses: map(sequence.try_frame, names)
        return
    stop, network = spawn_context().Event(), sequence.network
    reader = network.path if isinstance(network, SmearNetwork) else network
    prepare_args = sequence.source, sequence.folder, list(sequence.times), reader, list(sequence.aside)
    pool = processes(count, _prepare, prepare_args, stop=stop)
    pending: list[Future[Result]] = []

    def try_frames(names: Sequence[str], poses: Mapping[str, Array]) -> Iterator[Result]:
        try:
            pending[:] = [pool.submit(_try_frame, name, poses) for name in names]
        except OSError as error:
            raise not_started(error) from None
        for future in list(pending):
            yield future.result()

    try:
        yield try_frames
    except BrokenProcessPool:
        raise RunError("a process died, perhaps because of too little memory; add --jobs 1") from None
    finally:
        for future in pending:
            future.cancel()
        stop.set()
        pool.shutdown(wait=False)


_SEQUENCE: list[FrameSequence] = []  # of a process that was started


def _prepare(
    model: Path, frames: Path, names: Sequence[str], network: SmearReader | Path, aside: Sequence[str]
) -> None:
    """Prepare a process."""
    reader = SmearNetwork(network, threads=1) if isinstance(network, Path) else network
    _SEQUENCE[:] = [FrameSequence(model, frames, names, reader)]
    _SEQUENCE[0].set_aside(aside)


def _try_frame(name: str, poses: Mapping[str, Array]) -> Result:
    """Return a frame's result by the poses of all that are known."""
    (sequence,) = _SEQUENCE
    sequence.poses = dict(poses)
    return sequence.try_frame(name)


def _first_line(sequence: FrameSequence) -> str:
    """Return the line that stands for a call: its model, frames, network and version."""
    model = {path.name: file_digest(path) for path in sorted(sequence.source.iterdir()) if path.is_file()}
    states = [(sequence.folder / name).stat() for name in sequence.times if (sequence.folder / name).exists()]
    frames = list(sequence.times), [(state.st_size, state.st_mtime_ns) for state in states]
    network = getattr(sequence.network, "model_id", "")
    call = sha256(
        repr((model, frames, network, list(sequence.aside), __version__)).encode("utf-8", "surrogateescape")
    ).hexdigest()
    return json.dumps(signed({"call_sha256": call}, "recover"))


def _line(name: str, result: Result) -> str:
    """Return a result as JSON."""
    if isinstance(result, str):
        return json.dumps({"name": name, "refused": result})
    values = {one.name: np.asarray(getattr(result, one.name)).tolist() for one in fields(result)}
    return json.dumps({"name": name, **values})


def _read_line(line: str) -> tuple[str, Result]:
    """Return the name and the result of a line."""
    values = json.loads(line)
    name = values.pop("name")
    if "refused" in values:
        return name, values["refused"]
    points, residual = np.array(values.pop("points"), int), values.pop("residual_px")
    arrays = {key: np.array(value, float) for key, value in values.items()}
    return name, RecoveredFrame(points=points, residual_px=residual, **arrays)
