"""What a job needs of its files, read ahead of the work: content, digests, contents of its neighbours."""

import hashlib
import threading
from collections.abc import Generator, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from queue import Empty, Queue
from typing import Any, TypeVar

from blur2view.cli.batch.job import Find, Job, Outcome, failed
from blur2view.errors import Blur2ViewError, ImageError
from blur2view.files import quick_digest
from blur2view.images.image import Content
from blur2view.images.inputs import Source
from blur2view.images.video import EndOfVideo, frame_time

READ_AHEAD = 1  # bound; jobs that are read before they are begun, besides the one that is being read
T = TypeVar("T")


def read_ahead(jobs: Iterable[Job], find: Find) -> Generator[tuple[Job, Outcome | None]]:
    """Yield jobs that a thread has read, each forgotten once it is passed on.

    With those that were done before, or cannot be read, comes the outcome.
    """
    yield from _ahead(_begun(jobs, find))


def forget() -> None:
    """Forget the last few frames and photographs that were read."""
    _content.cache_clear()


def _ahead(items: Iterator[T]) -> Generator[T]:
    """Yield items that a thread makes, some ahead; what it raises is raised where the item is due.

    The thread ends with the item in hand once nobody wants more.
    """
    queue, stop = Queue[tuple[bool, Any]](READ_AHEAD), threading.Event()

    def make() -> None:
        try:
            for item in items:
                queue.put((True, item))
                del item  # which may be a large frame, while the next is made
                if stop.is_set():
                    return
            queue.put((False, None))
        except BaseException as error:
            queue.put((False, error))

    threading.Thread(target=make).start()
    try:
        while (pair := queue.get())[0]:
            item = pair[1]
            del pair
            yield item
            del item
        if pair[1] is not None:
            raise pair[1]
    finally:
        stop.set()
        with suppress(Empty):
            while True:
                queue.get_nowait()


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
        return job, failed(job.name, error)


def _identified(job: Job) -> Job:
    """Return a job with the digests of its file and all else that its result depends on; or its refusal.

    A photograph without neighbours is read here, unless it has been.
    """
    if job.refusal is not None:
        raise job.refusal
    alone = job.source.frame is None and not job.neighbours
    content = job.source.read() if alone and job.content is None else job.content
    own_digest = (
        hashlib.sha256(content).hexdigest()
        if alone and isinstance(content, bytes)
        else _file_digest(job.source.path)
    )
    neighbour_digests = (
        [_file_digest(source.path) for _, source in job.neighbours] if job.source.frame is None else []
    )
    parts = job.call_sha256, job.source.frame, [steps for steps, _ in job.neighbours], neighbour_digests
    digest = hashlib.sha256(repr(parts).encode()).hexdigest()
    return replace(job, input_sha256=own_digest, job_sha256=digest, content=content)


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
