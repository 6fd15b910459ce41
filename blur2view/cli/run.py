"""A command over photographs: what it writes is checked before any work; done, printed, written."""

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.cli.options import Folder
from blur2view.cli.terminal import DONE, FAILED, INTERRUPTED, Say, complain, plural, printable, progress
from blur2view.cli.work import Setup
from blur2view.errors import Blur2ViewError, ImageError, OutputError, RunError
from blur2view.exposure.gyroflow import gyroflow_log
from blur2view.images.inputs import Inputs
from blur2view.images.source import timestamps_of
from blur2view.networks.model_file import usable_cores
from blur2view.output_files import check_file, is_whole, real_paths, writable_folders, write_file
from blur2view.results.photograph import Photograph, table_text
from blur2view.runs.executors import Cluster, executor
from blur2view.runs.jobs import Executor, Job, Outcome, Work, identified, neighbours_of, outcomes

FAILURES = {"failures": "(list) Photographs that failed: image, error."}
Files = tuple[Path, ...]
Targets = Mapping[str, tuple[Path | None, str]]
"""Files of all photographs with what they are, empty of what is checked elsewhere, by their options."""


class End(Enum):
    """How a run ended: after all photographs, as none can be done any more, by Ctrl-C."""

    WHOLE = auto()
    STOPPED = auto()
    INTERRUPTED = auto()


@dataclass(kw_only=True, eq=False)
class Finished:
    """What came of a run over photographs, in their order, as far as it has come."""

    outcomes: list[tuple[Job, Outcome]] = field(default_factory=list)
    end: End = End.WHOLE
    seconds: float = 0.0
    has_table: bool = True  # it was not asked for, or could be written
    has_log: bool = True  # likewise

    @property
    def records(self) -> dict[Job, Photograph]:
        """The records of all, but for folders that cannot be used, which are no photographs."""
        return {
            job: one.photograph
            for job, one in self.outcomes
            if job.refusal is None or not job.source.path.is_dir()
        }

    @property
    def done(self) -> list[Outcome]:
        """What did not fail."""
        return [one for _, one in self.outcomes if not one.error]

    @property
    def failures(self) -> list[dict[str, str]]:
        """What failed: image and error."""
        return [{"image": str(job.source), "error": one.error} for job, one in self.outcomes if one.error]

    @property
    def exit_code(self) -> int:
        """Return the exit code: 0 done, 1 something failed, 130 interrupted."""
        if self.end is End.INTERRUPTED:
            return INTERRUPTED
        whole = self.end is End.WHOLE and self.has_table and self.has_log
        return DONE if whole and not self.failures else FAILED


@dataclass(frozen=True, kw_only=True, eq=False)
class Photographs:
    """The photographs of a call, how each is estimated, and how it goes through them."""

    inputs: Inputs
    setup: Setup

    @classmethod
    def of(cls, command: str, options: Any) -> "Photographs":
        """Return those of a command with these options."""
        return cls(inputs=options.common.reading.inputs(), setup=Setup.of(command, options))

    @contextmanager
    def writing(self, targets: Targets, *folders: Path, taken: Iterable[Path] = ()) -> Iterator[None]:
        """Check all that the call writes, before any work; at the end remove folders that stayed empty.

        The network is loaded, ``folders`` and those of the ``targets`` are created, with the table among
        them. ``taken`` are further files that the call writes. ModelError or OutputError of what cannot be
        used.
        """
        self.setup.network()  # first, so that a damaged one is named before any photograph
        every = {"--csv": (self.setup.common.table.csv, "table"), **targets}
        written = {name: (path, what) for name, (path, what) in every.items() if path is not None}
        more = self.setup.in_time.timestamps, self.setup.common.lens.database
        used, names = self.inputs.read | real_paths(filter(None, more)), real_paths(taken)
        with writable_folders(*folders, *(path.parent for path, _ in written.values())):
            for option, (target, what) in written.items():
                real = os.path.realpath(target)
                if real in names:
                    raise OutputError(f"{target}: two results would be one file; name another with {option}")
                names.add(real)
                if what:
                    check_file(target, what, used, option=option)
            yield

    def jobs(self, files: Sequence[Files | OutputError] = ()) -> list[Job]:
        """Return the jobs, with the files of each, if it has some, or why they cannot be written.

        ImageError if a table of times lacks one that is there; frames have the times of their video.
        """
        sources, in_time = self.inputs.sources, self.setup.in_time
        if in_time.timestamps is not None:
            usable = [one for one in sources if one.path.is_file() and one not in self.inputs.refused]
            stills = [one for one in usable if one.frame is None]
            times = timestamps_of([one.path for one in stills], in_time.timestamps)
            of = dict(zip(stills, times, strict=True))
            sources = [replace(one, time_s=of.get(one)) for one in sources]
        near, names, jobs = neighbours_of(sources, in_time.sequence), self.inputs.names(), []
        for index, source in enumerate(sources):
            refusal: Blur2ViewError | None = None
            planned = files[index] if files else ()
            if source in self.inputs.refused:
                refusal, planned = ImageError(self.inputs.refused[source]), ()
            elif isinstance(planned, OutputError):
                refusal, planned = planned, ()
            job = Job(index=index, source=source, name=names[index], neighbours=near[index])
            jobs.append(replace(job, files=planned, refusal=refusal))
        return jobs

    def run(
        self,
        jobs: Sequence[Job],
        work: Work,
        *,
        show: Callable[[Job, Outcome], str] = lambda job, outcome: outcome.summary,
        resume: bool = False,
    ) -> Finished:
        """Return what came of all photographs in order, after printing a line for each and writing the table.

        Ends early, after a line that says how to go on, if it is interrupted or no photograph can be done any
        more, as on a full disk. ``show`` returns what is printed of each, empty for nothing; ``resume`` skips
        those whose results are whole.
        """
        run, warned, start = Finished(), set[str](), time.monotonic()
        do, find = self._executor(len(jobs)), self.done_before if resume else lambda job: None
        results = outcomes(work, jobs, do, find=find, sends=self.setup.common.many.dask is not None)
        try:
            with progress(len(jobs)) as (say, advance), closing(results):
                for job, outcome in results:
                    self._say(job, outcome, show(job, outcome), say, warned, alone=len(jobs) == 1)
                    run.outcomes.append((job, outcome))
                    advance()
        except KeyboardInterrupt:
            run.end = End.INTERRUPTED
        except (RunError, OutputError) as error:
            complain(error)
            run.end = End.STOPPED
        run.seconds = time.monotonic() - start
        if run.end is End.INTERRUPTED or (run.end is End.STOPPED and len(jobs) > 1):
            line = f"blur2view: {run.end.name.lower()}"
            if len(jobs) > 1:
                line += f" after {len(run.outcomes)} of {plural(len(jobs), 'photograph')}"
                line += "; the same call with --resume does the rest" * any(job.files for job in jobs)
            print(line, file=sys.stderr, flush=True)
        table, rows = self.setup.common.table.csv, list(run.records.values())
        if table is not None and rows:
            run.has_table = _written(table, lambda: table_text(rows))
        return run

    def done_before(self, job: Job) -> Outcome | None:
        """Return the outcome of a photograph whose results are whole, and of the same input and options."""
        job = identified(job)
        try:
            record = Photograph.from_json(job.files[-1].read_bytes())
        except (OSError, ValueError, TypeError, LookupError):  # it was cut off, or changed
            return None
        if (record.input_sha256, record.options_sha256) != (job.input_sha256, self.setup.key(job)):
            return None
        if not all(map(is_whole, job.files)):
            return None
        record, text = replace(record, name=job.name), f"{job.source}: done before"
        return Outcome(photograph=record, summary=text, skipped=True)

    def _executor(self, count: int) -> Executor:
        """Return what does so many jobs: a cluster, or processes."""
        many = self.setup.common.many
        if many.dask is None:
            return executor(max(min(many.jobs or usable_cores(), count), 1))
        return Cluster(many.dask)

    def _say(self, job: Job, outcome: Outcome, text: str, say: Say, warned: set[str], *, alone: bool) -> None:
        """Print what became of a photograph: why it failed, or the text; warnings, one about each option."""
        printing = self.setup.common.printing
        if outcome.error:
            complain(Blur2ViewError(outcome.error), say)
        elif text and not printing.quiet and (alone or printing.verbose or not outcome.skipped):
            lines = text.split("\n") if alone or printing.verbose else [text.partition("\n")[0]]
            say("\n".join(map(printable, lines)))
        for warning in outcome.warnings:
            if (about := warning.partition(" ")[0]) not in warned and not printing.quiet:
                complain(Blur2ViewError(f"{job.source}: {warning}"), say)
            warned.add(about)

    def print_total(self, run: Finished, *written: Path | None) -> None:
        """Print how many of several photographs were done, and what all of them were written to."""
        if run.end is not End.WHOLE or len(run.outcomes) < 2 or self.setup.common.printing.quiet:
            return
        skipped, failed = sum(one.skipped for one in run.done), len(run.failures)
        done = len(run.done) - skipped
        parts = [f"{done} done"] if done or not (skipped or failed) else []
        parts += [f"{skipped} done before"] * bool(skipped) + [f"{failed} failed"] * bool(failed)
        rate = f", {done / run.seconds:.2g} a second" if done and run.seconds > 0 else ""
        line = f"{plural(len(run.outcomes), 'photograph')}: {', '.join(parts)} in {run.seconds:.1f} s{rate}"
        paths = [printable(str(path)) for path in written if path is not None]
        print(line + f"; wrote {' and '.join(paths)}" * bool(paths and done))


def run_into_folder(
    photographs: Photographs,
    work: Work,
    folder: Folder,
    *,
    listed: str,
    endings: Sequence[str],
    beside: Callable[[Path], Sequence[Path]] = lambda name: (),
    log: Path | None = None,
) -> int:
    """Return the exit code, after the work on every photograph, which has files if a folder is named.

    They are called by the photograph's stem and these ``endings``, in the order of writing, JSON last;
    ``beside`` gives further files of a photograph by its name, below the folder, which are written first.
    With --json the documents are printed as a list of this name; a ``log`` of their rates is Gyroflow's.
    """
    output, table = folder.output, photographs.setup.common.table.csv
    plan = [] if output is None else list(_plan(photographs.inputs, output, endings, beside))
    paths = [path for files in plan for path in files]
    folders = [] if output is None else [output, *sorted({path.parent for path in paths})]
    if log is not None and not photographs.inputs.one_video:
        raise OutputError(f"{log}: a log of rates is of one video; name its frames alone, or omit --gyroflow")
    with photographs.writing({"--gyroflow": (log, "log")}, *folders, taken=paths):
        jobs = photographs.jobs(list(_refused(photographs.inputs, plan)))
        show = (lambda job, outcome: "") if folder.json else lambda job, outcome: outcome.summary
        finished = photographs.run(jobs, work, show=show, resume=folder.resume)
        records = [one.photograph for one in finished.done]
        if log is not None and records and finished.end is End.WHOLE:
            video = next(job.source.path.name for job, one in finished.outcomes if not one.error)
            finished.has_log = _written(log, lambda: gyroflow_of(records, video).encode())
    if folder.json:
        done = [one.plain() for one in records]
        print(json.dumps({listed: done, "failures": finished.failures}, indent=2, allow_nan=False))
    else:
        written = output, table if finished.has_table else None, log if finished.has_log else None
        photographs.print_total(finished, *written)
    return finished.exit_code


def _written(target: Path, content: Callable[[], bytes]) -> bool:
    """Return whether a file about all photographs could be written; all else is of use without it."""
    try:
        write_file(target, content())
    except OutputError as error:
        complain(error)
        return False
    return True


def gyroflow_of(records: Sequence[Photograph], video: str) -> str:
    """Return Gyroflow's log of the frames of a video whose rates and direction of time are known.

    OutputError without any, or if the video gives two of them one time.
    """
    known = [
        (one.timestamp_s, [(1 if one.gyroscope else -1) * rate for rate in (one.wx, one.wy, one.wz)])
        for one in records
        if one.time_known and one.exposure_s and one.timestamp_s is not None
        if one.wx is not None and one.wy is not None and one.wz is not None
    ]
    if not known:
        raise OutputError(
            "no frame has a time, a rate and a known direction of time; name a video, --focal and --exposure"
        )
    known.sort(key=lambda one: one[0] or 0.0)  # frames may be named in any order
    try:
        return gyroflow_log([time for time, _ in known], np.array([rate for _, rate in known]), video)
    except ValueError:
        raise OutputError(f"{video}: has two frames of one time; omit --gyroflow") from None


def _plan(
    inputs: Inputs, folder: Path, endings: Sequence[str], beside: Callable[[Path], Sequence[Path]]
) -> Iterator[Files]:
    """Yield the files of each photograph."""
    for name, whole in zip(inputs.result_names(), inputs.names(), strict=True):
        own = (Path(f"{name}{ending}") for ending in endings)
        yield tuple(folder / path for path in (*beside(Path(whole)), *own))


def _refused(inputs: Inputs, plan: Sequence[Files]) -> Iterator[Files | OutputError]:
    """Yield the files of each photograph, or why they must not be written.

    Inputs and files of other programs are never replaced, nor results of another photograph of the call.
    """
    read, first_of = inputs.read, dict[Path, object]()
    for source, files in zip(inputs.sources, plan, strict=bool(plan)):
        other = next((first_of[path] for path in files if path in first_of), None)
        first_of |= dict.fromkeys(files, source)
        try:
            if other is not None:
                raise OutputError(f"its results would be those of {other}; use another -o")
            for path in files:
                check_file(path, "result", read)
            yield files
        except OutputError as error:
            yield OutputError(f"{source}: {error}")


def wrote(job: Job, endings: Sequence[str]) -> str:
    """Return what a summary says of a photograph's files, if it has some."""
    if not job.files:
        return ""
    name = printable(str(job.files[-1]).removesuffix(endings[-1]))
    return f"; wrote {name}.{{{','.join(ending.removeprefix('.') for ending in reversed(endings))}}}"
