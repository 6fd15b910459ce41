"""Jobs, one for each photograph, which one process, several processes or a Dask cluster does."""

import errno
import hashlib
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import pairwise
from pathlib import Path
from queue import Empty, Queue
from typing import Any, TypeVar

from blur2view.cli.executors import Restarted, Shared, as_it_is, connected, wait_for_worker
from blur2view.errors import Blur2ViewError, ImageError, OutputError, RunError, within_memory
from blur2view.exposure.sequence import Features, Matches, Series
from blur2view.files import NO_ROOM, quick_digest, write_beside
from blur2view.images.image import Content
from blur2view.images.inputs import Source
from blur2view.images.video import EndOfVideo, frame_time
from blur2view.processes import not_started, processes
from blur2view.records.record import Record

AHEAD = 3  # bound; jobs begun per process: enough to keep it busy, few enough to hold their contents
READ_AHEAD = 1  # bound; jobs that are read before they are begun, besides the one that is being read
DISK_FULL = NO_ROOM | {errno.EROFS}
"""Errors after which the files of the next photograph could not be written either."""
T = TypeVar("T")
Neighbours = tuple[tuple[int, Source], ...]
"""The photographs before (-1) and after (1) a photograph, which help to decide the order of its ends."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """The job for one photograph, as the process gets it that works on it."""

    source: Source
    name: str = ""  # in tables and databases
    files: tuple[Path, ...] = ()  # files of its results, in the order of writing, its JSON last
    neighbours: Neighbours = ()
    refusal: Blur2ViewError | None = None  # why the job cannot begin
    plan: Any = None  # what its command already knows about it
    content: Content | None = None  # of its file, or a frame's pixels
    beside: Mapping[Source, Content] = field(default_factory=dict)  # contents of itself and its neighbours
    matches: Mapping[int, Matches] = field(default_factory=dict)  # with its neighbours, by steps in time
    input_sha256: str = ""  # of its file
    call_sha256: str = ""  # of the call's options, network and version
    job_sha256: str = ""  # of these and of all else that its result depends on


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """The result of the job for one photograph."""

    record: Record
    summary: str = ""  # what is printed; its first line stands for the photograph where there are many
    contents: Sequence[bytes] = ()  # of the job's files but the last, which is the record
    part: Any = None  # for what the command makes of all photographs
    skipped: bool = False  # whether an earlier call did the job

    @property
    def error(self) -> str:
        """Why the job failed, in one line; empty if it is done."""
        return self.record.error


Work = Callable[[Any], Outcome]
"""Does a job, in whichever process; Blur2ViewError of a job that fails."""
Find = Callable[[Job], Outcome | None]
"""Finds the outcome of a job that an earlier call did."""
Look = Callable[[Source, Content], Features]
"""Finds the features of a photograph, in whichever process; Blur2ViewError if it cannot be read."""
Done = Generator[tuple[Job, Outcome]]


def neighbours_in_time(sources: Sequence[Source], sequence: bool | None) -> list[Neighbours]:
    """Return the neighbours of each photograph, the earlier one first.

    Those of a frame lie beside it in its video; with ``sequence`` those of other photographs are named beside
    them and lie in the same folder; if ``sequence`` is False nothing has neighbours.
    """
    if sequence is False:
        return [()] * len(sources)
    after = dict(pairwise(source for source in sources if source.frame is None)) if sequence else {}
    before = {later: earlier for earlier, later in after.items()}
    neighbours = []
    for source in sources:
        near = (-1, before.get(source) or source.beside(-1)), (1, after.get(source) or source.beside(1))
        neighbours.append(tuple((k, other) for k, other in near if other and other.folder == source.folder))
    return neighbours


def in_processes(work: Work, jobs: Iterable[Job], find: Find, look: Look, *, count: int) -> Done:
    """Yield jobs with their outcomes, done by ``count`` processes, or by a thread if one is enough.

    The main thread matches neighbours and nothing else, so that Ctrl-C is answered at once; another one reads
    ahead. RunError where no process can be started.
    """
    start: Callable[[], Executor] = partial(processes, count) if count > 1 else partial(ThreadPoolExecutor, 1)
    slots = AHEAD * count if count > 1 else 1
    try:
        executor = Restarted(start, BrokenExecutor, Shared if count > 1 else as_it_is)
        yield from _in_order(work, jobs, find, look, executor, lambda: slots)
    except OSError as error:
        raise not_started(error) from None


def in_cluster(work: Work, jobs: Iterable[Job], find: Find, look: Look, *, address: str) -> Done:
    """Yield jobs with their outcomes, done by the workers of a Dask cluster (``tcp://HOST:8786``).

    A worker that is lost costs the time of its photographs: Dask gives them to others. RunError if Dask is
    not installed, no scheduler answers, there is no worker for some seconds, or whatever else keeps it from
    going on.
    """
    client, killed = connected(address)

    def alive() -> None:
        if not client.nthreads():
            wait_for_worker(client, address)

    try:
        executor = Restarted(partial(client.get_executor, pure=False), killed, as_it_is, alive)
        yield from _in_order(
            work, jobs, find, look, executor, lambda: AHEAD * max(sum(client.nthreads().values()), 1)
        )
    except Blur2ViewError:
        raise
    except Exception as error:  # of any type: the scheduler is gone, or a worker lacks a module
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RunError(
            f"{address}: cannot go on ({reason}); check that its scheduler runs and that its workers have "
            "this blur2view"
        ) from None
    finally:
        threading.Thread(target=client.close, daemon=True).start()  # it may wait in vain


def _in_order(
    work: Work, jobs: Iterable[Job], find: Find, look: Look, executor: Restarted, slots: Callable[[], int]
) -> Done:
    """Yield jobs in order with their outcomes, files written, done by an executor.

    At most ``slots()`` jobs wait for the features of their neighbours, and as many are begun. Those in hand
    when a process dies are tried once more, alone. A video that is cut off fails once, not with every frame.
    OutputError on a full disk.
    """
    waiting, pending = deque[tuple[Job, Outcome | None]](), deque[tuple[Job, Future[Outcome]]]()
    features = _Features(look, executor)
    series = Series(features.of)

    def begin() -> None:
        job, outcome = waiting.popleft()
        if outcome is None:
            job = replace(job, matches=series.around(job.source, job.neighbours))
            features.drop(job)
            shared = replace(job, content=None if job.content is None else executor.share(job.content))
            pending.append((shared, executor.submit(_perform, work, shared)))
        else:
            future = Future[Outcome]()
            future.set_result(outcome)
            pending.append((job, future))

    def oldest() -> tuple[Job, Outcome]:
        job, future = pending[0]
        try:
            outcome = executor.result(future)
        except executor.lost:
            outcome = _alone(work, job)
        pending.popleft()
        return replace(job, matches={}), _written(job, outcome)

    try:
        with closing(_ahead(_begun(jobs, find))) as begun:
            for job, outcome in begun:
                features.begin(job.beside)
                waiting.append((replace(job, beside={}), outcome))
                while len(waiting) > (slots() if job.neighbours else 0):
                    begin()
                del job
                while len(pending) >= slots():
                    yield oldest()
        while waiting:
            begin()
        while pending:
            yield oldest()
    finally:
        for _, future in pending:
            future.cancel()
        executor.executor.shutdown(wait=not pending and not waiting)
        _content.cache_clear()


class _Features:
    """Features of photographs that neighbours ask for, each found once, ahead of the jobs."""

    def __init__(self, look: Look, executor: Restarted) -> None:
        self._look, self._executor = look, executor
        self._found = dict[Source, tuple[Any, Future[Features | None]]]()  # with what was sent

    def begin(self, contents: Mapping[Source, Content]) -> None:
        """Begin to find the features of photographs."""
        for source, content in contents.items():
            if source not in self._found:
                shared = self._executor.share(content)
                future = self._executor.submit(_looked, self._look, source, shared)
                self._found[source] = shared, future

    def of(self, source: Source) -> Features | None:
        """Return the features of a photograph, None if it cannot be read."""
        if source not in self._found:
            return None
        shared, future = self._found[source]
        try:
            return self._executor.result(future)
        except self._executor.lost:
            with processes(1) as pool, suppress(BrokenExecutor):
                return pool.submit(_looked, self._look, source, shared).result()
            return None

    def drop(self, job: Job) -> None:
        """Forget the features of a job and of the jobs before it, because they are matched."""
        for source in (job.source, *(near for steps, near in job.neighbours if steps < 0)):
            self._found.pop(source, None)


def _looked(look: Look, source: Source, content: Content) -> Features | None:
    """Return the features of a photograph, None if it cannot be read, which costs a line of its own."""
    with suppress(Blur2ViewError), within_memory(source.path):
        return look(source, content)
    return None


def _ahead(items: Iterator[T]) -> Generator[T]:
    """Yield items that a thread makes, some ahead; what it raises is raised where the item is due.

    The thread ends with the item in hand once nobody wants more.
    """
    made, unwanted = Queue[tuple[bool, Any]](READ_AHEAD), threading.Event()

    def make() -> None:
        try:
            for item in items:
                made.put((True, item))
                del item  # which may be a large frame, while the next is made
                if unwanted.is_set():
                    return
            made.put((False, None))
        except BaseException as error:
            made.put((False, error))

    threading.Thread(target=make).start()
    try:
        while (pair := made.get())[0]:
            item = pair[1]
            del pair
            yield item
            del item
        if pair[1] is not None:
            raise pair[1]
    finally:
        unwanted.set()
        with suppress(Empty):
            while True:
                made.get_nowait()


def _begun(jobs: Iterable[Job], find: Find) -> Iterator[tuple[Job, Outcome | None]]:
    """Return an iterator over jobs that have been read, each forgotten once it is passed on.

    With those that were done before, or cannot be read, comes the outcome.
    """
    return filter(None, map(partial(_begin, find, set[Path]()), jobs))


def _begin(find: Find, cut: set[Path], job: Job) -> tuple[Job, Outcome | None] | None:
    """Read a job; None of a frame that was never recorded, or of a video among those that are ``cut`` off."""
    try:
        job = _identified(job)
        outcome = find(job)
        return (_read(job), None) if outcome is None else (replace(job, content=None), outcome)
    except Blur2ViewError as error:
        if isinstance(error, EndOfVideo):
            if error.whole or job.source.path in cut:
                return None
            cut.add(job.source.path)
        return job, _failed(job.name, error)


def _identified(job: Job) -> Job:
    """Return a job with the digests of its file and all else that its result depends on; or its refusal.

    A photograph without neighbours is read here, unless it has been.
    """
    if job.refusal is not None:
        raise job.refusal
    alone = job.source.frame is None and not job.neighbours
    content = job.source.read() if alone and job.content is None else job.content
    own = (
        hashlib.sha256(content).hexdigest()
        if alone and isinstance(content, bytes)
        else _file_digest(job.source.path)
    )
    near = [_file_digest(source.path) for _, source in job.neighbours] if job.source.frame is None else []
    every = job.call_sha256, job.source.frame, [steps for steps, _ in job.neighbours], near
    digest = hashlib.sha256(repr(every).encode()).hexdigest()
    return replace(job, input_sha256=own, job_sha256=digest, content=content)


def _file_digest(path: Path) -> str:
    """Return the SHA-256 of a photograph's or video's file, empty where it cannot be read."""
    with suppress(OSError):
        return _digest(path, path.stat().st_size, path.stat().st_mtime_ns)
    return ""


@lru_cache(maxsize=8)
def _digest(path: Path, size: int, changed_ns: int) -> str:
    """Return the digest of a file as it was changed last: each frame of a video asks for it."""
    return quick_digest(path)


def _read(job: Job) -> Job:
    """Return a job with the content of its file, the time of a frame, and the contents of its neighbours.

    A video is read in order, and the last few frames stay in memory.
    """
    if job.content is not None:
        return job
    if not job.neighbours:
        content, time_s = _content.__wrapped__(job.source)
        return replace(job, source=replace(job.source, time_s=time_s), content=content)
    beside = dict[Source, Content]()
    for steps, source in sorted([(0, job.source), *job.neighbours], key=lambda pair: pair[0]):
        try:
            beside[source], time_s = _content(source)
        except ImageError:
            if not steps:
                raise
            continue
        if not steps:
            job = replace(job, source=replace(source, time_s=time_s), content=beside[source])
    return replace(job, beside=beside)


@lru_cache(maxsize=3)
def _content(source: Source) -> tuple[Content, float | None]:
    """Return the content of a photograph, and the time of a frame; ImageError if it cannot be read."""
    return source.read(), source.time_s if source.frame is None else frame_time(source.path, source.frame)


def _perform(work: Work, job: Job) -> Outcome:
    """Return the outcome of one photograph, its files unwritten."""
    try:
        with within_memory(job.source.path):
            return work(job)
    except Blur2ViewError as error:
        return _failed(job.name, error)


def _failed(name: str, error: Blur2ViewError) -> Outcome:
    """Return the outcome of a photograph that failed."""
    return Outcome(record=Record(name=name, error=str(error)))


def _written(job: Job, outcome: Outcome) -> Outcome:
    """Return an outcome whose files are written, or a failure; OutputError on a full disk."""
    if not outcome.contents:
        return outcome
    record = replace(outcome.record, files_sha256=combined_digest(outcome.contents))
    document = (record.to_json() + "\n").encode()
    try:
        write_beside(dict(zip(job.files, [*outcome.contents, document], strict=True)))
    except OutputError as error:
        if isinstance(error.__cause__, OSError) and error.__cause__.errno in DISK_FULL:
            raise
        return _failed(job.name, OutputError(f"{job.name}: {error}"))
    return replace(outcome, record=record, contents=())


def combined_digest(contents: Iterable[bytes]) -> str:
    """Return one SHA-256 of the sizes and contents of files, in the order of writing."""
    digest = hashlib.sha256()
    for content in contents:
        digest.update(b"%d " % len(content) + content)
    return digest.hexdigest()


def _alone(work: Work, job: Job) -> Outcome:
    """Return the outcome of a job in a process of its own, a failure if that dies."""
    with processes(1) as pool:
        try:
            return pool.submit(_perform, work, job).result()
        except BrokenExecutor:
            why = "the process that read it died, perhaps because of too little memory; resize it"
            return _failed(job.name, ImageError(f"{job.source}: {why}"))
