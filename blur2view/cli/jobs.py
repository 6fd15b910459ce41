"""Jobs, a photograph each, and what does them: this process, several, or the workers of a Dask cluster."""

import errno
import hashlib
import logging
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool, ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import pairwise
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2

from blur2view.errors import Blur2ViewError, ImageError, OutputError, RunError, within_memory
from blur2view.files import file_digest, write_beside
from blur2view.images.inputs import Source
from blur2view.images.video import EndOfVideo, frame_time
from blur2view.results.photograph import Photograph

if TYPE_CHECKING:
    from blur2view.colmap.database import ProjectImage
    from blur2view.exposure.views import ExposureViews

CONNECT_S, WORKERS_S = 5, 10  # bounds: for a scheduler to answer, and then for a worker to be there
LOGGERS = ("distributed", "distributed.client", "tornado", "tornado.application", "asyncio")
"""Loggers of Dask that are silenced: its errors are printed as lines of blur2view."""
AHEAD = 3  # bound; jobs begun per process: enough to keep it busy, few enough to hold their contents
DISK_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG}
"""Errors after which the next photograph's files would not fit either."""
Neighbours = tuple[tuple[int, Source], ...]
"""Photographs before (-1) and after (1) one in time, which help to decide the order of its ends."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """One photograph, as it goes to the process that works on it."""

    source: Source
    name: str = ""  # in tables and databases
    files: tuple[Path, ...] = ()  # where its results go, in the order of writing, its JSON last
    neighbours: Neighbours = ()
    refusal: Blur2ViewError | None = None  # why it cannot be begun
    plan: "ProjectImage | None" = None  # its image in a project that its views are added to
    contents: Mapping[Source, bytes] = field(default_factory=dict)  # of its file and its neighbours'
    input_sha256: str = ""  # of its file
    options_sha256: str = ""  # of the call's options, and of all else that its result depends on

    @property
    def content(self) -> bytes:
        """The content of its file."""
        return self.contents[self.source]


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What comes of one photograph."""

    photograph: Photograph
    summary: str = ""  # what is printed; its first line stands for the photograph where there are many
    contents: Sequence[bytes] = ()  # of the job's files but the last, which is the record
    section: str = ""  # of the report, HTML
    views: "ExposureViews | None" = None  # for a database
    skipped: bool = False  # whether an earlier call did it

    @property
    def error(self) -> str:
        """Why it failed, one line; empty if it is done."""
        return self.photograph.error


Work = Callable[[Any], Outcome]
"""Does a job, in whichever process; Blur2ViewError of a job that fails."""
Find = Callable[[Job], Outcome | None]
"""Finds the outcome of a job that an earlier call did."""
Done = Generator[tuple[Job, Outcome]]


def neighbours_of(sources: Sequence[Source], sequence: bool | None) -> list[Neighbours]:
    """Return the neighbours of each photograph, the earlier one first.

    Those of a frame lie beside it in its video; with ``sequence`` those of other photographs are named beside
    them and lie in the same folder; if ``sequence`` is False nothing has neighbours.
    """
    if sequence is False:
        return [()] * len(sources)
    after = dict(pairwise(source for source in sources if source.frame is None)) if sequence else {}
    before = {later: earlier for earlier, later in after.items()}
    found = []
    for source in sources:
        near = (-1, before.get(source) or source.beside(-1)), (1, after.get(source) or source.beside(1))
        found.append(tuple((k, other) for k, other in near if other and other.folder == source.folder))
    return found


def in_processes(work: Work, jobs: Iterable[Job], find: Find, *, count: int) -> Done:
    """Yield jobs with their outcomes, done by ``count`` processes, or by a thread if one is enough.

    The main thread works on nothing, so that Ctrl-C is answered at once. RunError where no process can be
    started.
    """
    start: Callable[[], Executor] = partial(_pool, count) if count > 1 else partial(ThreadPoolExecutor, 1)
    slots = AHEAD * count if count > 1 else 1
    try:
        yield from _in_order(work, jobs, find, start, lambda: slots)
    except OSError as error:
        reason = f"{error.strerror or error}; give it fewer with --jobs"
        raise RunError(f"no processes can be started ({reason})") from None


def in_cluster(work: Work, jobs: Iterable[Job], find: Find, *, address: str) -> Done:
    """Yield jobs with their outcomes, done by the workers of a Dask cluster (``tcp://HOST:8786``).

    A worker that is lost costs the time of its photographs: Dask gives them to others. RunError if Dask is
    not installed, no scheduler answers, there is no worker, or whatever else keeps it from going on.
    """
    client, killed = _connected(address)
    start = partial(client.get_executor, pure=False)
    try:
        yield from _in_order(
            work, jobs, find, start, lambda: AHEAD * max(sum(client.nthreads().values()), 1), killed
        )
    except Blur2ViewError:
        raise
    except Exception as error:  # of any type, as the scheduler is gone, or a worker lacks a module
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RunError(
            f"{address}: cannot go on ({reason}); see that its scheduler runs and its workers have this "
            "blur2view"
        ) from None
    finally:
        threading.Thread(target=client.close, daemon=True).start()  # it may wait for a scheduler that is gone


def _in_order(
    work: Work,
    jobs: Iterable[Job],
    find: Find,
    start: Callable[[], Executor],
    slots: Callable[[], int],
    lost: type[Exception] = BrokenProcessPool,
) -> Done:
    """Yield jobs in order with their outcomes, files written, done by the executor that ``start`` returns.

    At most ``slots()`` jobs are begun at a time. A process that dies (of too little memory, of a damaged file
    that crashes a decoder) is ``lost`` with the jobs in hand; each is tried once more, alone. A video that is
    cut off fails once, not with every frame. OutputError on a full disk.
    """
    executor, pending = start(), deque[tuple[Job, Future[Outcome]]]()

    def oldest() -> tuple[Job, Outcome]:
        job, future = pending[0]
        try:
            outcome = future.result()
        except lost:
            outcome = _alone(work, job)
        pending.popleft()
        return replace(job, contents={}), _written(job, outcome)

    try:
        for job, outcome in _begun(jobs, find):
            future = Future[Outcome]()
            if outcome is None:
                try:
                    future = executor.submit(_perform, work, job)
                except lost:  # meanwhile
                    executor = start()
                    future = executor.submit(_perform, work, job)
            else:
                future.set_result(outcome)
            pending.append((job, future))
            while len(pending) >= slots():
                yield oldest()
        while pending:
            yield oldest()
    finally:
        for _, future in pending:
            future.cancel()
        executor.shutdown(wait=False)


def _begun(jobs: Iterable[Job], find: Find) -> Iterator[tuple[Job, Outcome | None]]:
    """Yield jobs that have been read, and of those that were done before, or cannot be read, the outcome."""
    cut = set[Path]()  # videos that are cut off
    for job in jobs:
        try:
            job = _identified(job)
            outcome = find(job)
            yield (_read(job), None) if outcome is None else (job, outcome)
        except Blur2ViewError as error:
            if isinstance(error, EndOfVideo):
                if error.whole or job.source.path in cut:
                    continue
                cut.add(job.source.path)
            yield job, _failed(job.name, error)


def _identified(job: Job) -> Job:
    """Return a job with the digests of its file and all else that its result depends on; or its refusal."""
    if job.refusal is not None:
        raise job.refusal
    near = [_digest_of(source.path) for _, source in job.neighbours] if job.source.frame is None else []
    every = job.options_sha256, job.source.frame, [steps for steps, _ in job.neighbours], near
    digest = hashlib.sha256(repr(every).encode()).hexdigest()
    return replace(job, input_sha256=_digest_of(job.source.path), options_sha256=digest)


def _digest_of(path: Path) -> str:
    """Return the SHA-256 of a photograph's or video's file, empty where it cannot be read."""
    with suppress(OSError):
        return _digest(path, path.stat().st_size, path.stat().st_mtime_ns)
    return ""


@lru_cache(maxsize=8)
def _digest(path: Path, size: int, changed_ns: int) -> str:
    """Return the SHA-256 of a file as it was changed last: each frame of a video asks for it."""
    return file_digest(path)


def _read(job: Job) -> Job:
    """Return a job with all contents, and the time of a frame; unreadable neighbours are left out.

    A video is read in order.
    """
    contents, source = {}, job.source
    for _, near in sorted([(0, source), *job.neighbours], key=lambda pair: pair[0]):
        try:
            contents[near] = near.read()
        except ImageError:
            if near == source:
                raise
    if source.frame is not None:
        source = replace(source, time_s=frame_time(source.path, source.frame))
    return replace(job, source=source, contents=contents)


def _perform(work: Work, job: Job) -> Outcome:
    """Return the outcome of one photograph, its files unwritten."""
    try:
        with within_memory(job.source.path):
            return work(job)
    except Blur2ViewError as error:
        return _failed(job.name, error)


def _failed(name: str, error: Blur2ViewError) -> Outcome:
    """Return the outcome of a photograph that fails."""
    return Outcome(photograph=Photograph(name=name, error=str(error)))


def _written(job: Job, outcome: Outcome) -> Outcome:
    """Return an outcome whose files are written, or a failure; OutputError on a full disk."""
    if not outcome.contents:
        return outcome
    photograph = replace(outcome.photograph, files_sha256=digest_of_files(outcome.contents))
    record = (photograph.to_json() + "\n").encode()
    try:
        write_beside(dict(zip(job.files, [*outcome.contents, record], strict=True)))
    except OutputError as error:
        if isinstance(error.__cause__, OSError) and error.__cause__.errno in DISK_FULL:
            raise
        return _failed(job.name, OutputError(f"{job.name}: {error}"))
    return replace(outcome, photograph=photograph, contents=())


def digest_of_files(contents: Iterable[bytes]) -> str:
    """Return one SHA-256 of the sizes and contents of files, in the order of writing."""
    digest = hashlib.sha256()
    for content in contents:
        digest.update(b"%d " % len(content) + content)
    return digest.hexdigest()


def _alone(work: Work, job: Job) -> Outcome:
    """Return the outcome of a job in a process of its own, a failure if that dies."""
    with _pool(1) as pool:
        try:
            return pool.submit(_perform, work, job).result()
        except BrokenProcessPool:
            why = "the process that read it died, perhaps of too little memory; resize it"
            return _failed(job.name, ImageError(f"{job.source}: {why}"))


def _pool(count: int) -> ProcessPoolExecutor:
    """Return processes that start afresh: a fork would copy the threads' locks of the libraries.

    They import no module of the current folder, whatever it is called.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    return ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=_begin)


def _begin() -> None:
    """Prepare a process: it ends with its parent, leaves Ctrl-C to it and uses one thread."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    cv2.setNumThreads(1)


def _end_with_parent() -> None:
    """End this process when its parent is killed: nobody would take its results."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _connected(address: str) -> tuple[Any, type[Exception]]:
    """Return a client of a Dask scheduler, and the error of a job that killed its workers.

    A scheduler that does not answer in time is RunError, as another program at the address may wait for ever.
    """
    try:
        import distributed
    except ImportError:
        raise RunError("--dask needs Dask; install it with: pip install 'dask[distributed]'") from None
    for name in LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    answer = Future[Any]()

    def connect() -> None:
        try:
            answer.set_result(distributed.Client(address, timeout=CONNECT_S))
        except BaseException as error:  # of any type, where no scheduler answers
            answer.set_exception(OSError(" ".join(str(error).split()) or type(error).__name__))

    threading.Thread(target=connect, daemon=True).start()
    try:
        client = answer.result(CONNECT_S)
    except (OSError, TimeoutError) as error:
        reason = str(error) or f"in {CONNECT_S} s"
        raise RunError(f"{address}: no Dask scheduler answers ({reason}); is there one?") from None
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except TimeoutError:
        raise RunError(f"{address}: has no worker; start some with: dask worker {address}") from None
    return client, distributed.scheduler.KilledWorker
