"""A command over many photographs: what it writes is checked before any work, done, printed, noted."""

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from pathlib import Path
from typing import Any

from blur2view.cli.options import InTime, Lens, Many, Printing, Resuming
from blur2view.cli.terminal import Say, complain, plural, printable, progress
from blur2view.cli.work import Setup
from blur2view.errors import Blur2ViewError, ImageError, OutputError, RunError
from blur2view.images.inputs import Inputs
from blur2view.images.timestamps import timestamps_of
from blur2view.networks.model_file import usable_cores
from blur2view.output_files import check_file, real_paths, writable_folders, write_file
from blur2view.results.photograph import Photograph, table_text
from blur2view.runs.executors import Executor, executor
from blur2view.runs.job import Job, Outcome, Work, identified, neighbours_of
from blur2view.runs.journal import Journal, journal_beside
from blur2view.runs.loop import outcomes

DONE, FAILED, INTERRUPTED = 0, 1, 130
DAMAGE = (OSError, ValueError, TypeError, LookupError)
"""What reading a result may raise that was cut off, or changed."""
Files = tuple[Path, ...]
Targets = Mapping[str, tuple[Path | None, str]]
"""Files of all photographs with what they are, empty of what is checked elsewhere, by their options."""


class End(Enum):
    """How a run ended: after all photographs, by too many failures, by Ctrl-C, or as none can be done."""

    WHOLE = auto()
    STOPPED = auto()
    INTERRUPTED = auto()
    BROKEN = auto()  # then files of all photographs stay as an earlier call left them


@dataclass(kw_only=True, eq=False)
class Finished:
    """What came of a run over photographs, in their order, as far as it has come."""

    outcomes: list[tuple[Job, Outcome]] = field(default_factory=list)  # if they are kept
    failures: list[dict[str, str]] = field(default_factory=list)  # image and error
    count: int = 0
    skipped: int = 0  # by an earlier call
    end: End = End.WHOLE
    has_table: bool = True  # it was not asked for, or could be written
    seconds: float = 0.0

    @property
    def exit_code(self) -> int:
        """Return the exit code: 0 done, 1 something failed, 130 interrupted."""
        if self.end is End.INTERRUPTED:
            return INTERRUPTED
        return FAILED if self.failures or self.end is End.BROKEN or not self.has_table else DONE


@dataclass(frozen=True, kw_only=True, eq=False)
class Earlier:
    """What earlier calls did with photographs: their files say it, or a journal of what has none."""

    setup: Setup
    resume: bool = False
    journal: Journal | None = None

    def find(self, job: Job) -> Outcome | None:
        """Return the outcome of a photograph with the same input and options, if its results are there."""
        if not self.resume or not (job.files or self.journal):
            return None
        job = identified(job)
        key, besides = f"{job.input_sha256} {self.setup.key(job)}", {}
        try:
            if job.files:
                record = Photograph.from_json(job.files[-1].read_bytes())
                whole = all(path.is_file() for path in job.files)
            else:
                line = self.journal.find(key) if self.journal else None
                record, besides = Photograph(**(line or {})["photograph"]), (line or {})["besides"]
                whole = True
        except DAMAGE:
            return None
        if not whole or key != f"{record.input_sha256} {record.options_sha256}":
            return None
        record, text = replace(record, name=job.name), f"{job.source}: done before"
        return Outcome(photograph=record, summary=text, besides=besides, skipped=True)

    def keep(self, job: Job, outcome: Outcome) -> None:
        """Note what was made of a photograph that has no files; OutputError if it cannot be noted."""
        if self.journal is not None:
            one = outcome.photograph
            content = {"photograph": vars(one), "besides": dict(outcome.besides)}
            self.journal.note(f"{one.input_sha256} {one.options_sha256}", content)


@dataclass(frozen=True, kw_only=True, eq=False)
class Photographs:
    """The photographs of a call, how each is estimated, and how it goes through them."""

    inputs: Inputs
    setup: Setup
    many: Many
    printing: Printing
    lens: Lens
    in_time: InTime
    resuming: Resuming
    table: Path | None = None

    @classmethod
    def of(cls, command: str, options: Any) -> "Photographs":
        """Return those of a command with these options, which have groups of the names used here."""
        return cls(
            inputs=options.reading.inputs(),
            setup=Setup.of(command, options),
            many=options.many,
            printing=options.printing,
            lens=options.lens,
            in_time=getattr(options, "in_time", InTime(sequence=False)),
            resuming=getattr(options, "resuming", Resuming()),
            table=options.table.csv,
        )

    @contextmanager
    def opened(
        self, targets: Targets, *folders: Path, taken: Iterable[Path] = (), journal: bool = True
    ) -> Iterator[Earlier]:
        """Check all that the call writes, and yield what earlier ones did.

        The network is loaded, ``folders`` and those of the ``targets`` are created, with the table among
        them. ``taken`` are further files that the call writes. Without a ``journal`` results have files.
        ModelError or OutputError of what cannot be used.
        """
        self.setup.network()  # which is named first if it is none
        every = {"--csv": (self.table, "table"), **targets}
        written = {name: (path, what) for name, (path, what) in every.items() if path is not None}
        first = next((path for path, _ in written.values()), None)
        with writable_folders(*folders, *(path.parent for path, _ in written.values())):
            self._check(written, taken)
            noted = journal and first is not None
            resume = self.resuming.resume
            with journal_beside(first, resume=resume) if noted and first else nullcontext() as opened:
                yield Earlier(setup=self.setup, resume=resume, journal=opened)

    def _check(self, targets: Mapping[str, tuple[Path, str]], taken: Iterable[Path]) -> None:
        """Refuse targets that would replace what they must not, or be one with another."""
        read = [*(one.path for one in self.inputs.sources), *self.inputs.lists]
        more = self.in_time.timestamps, self.lens.database
        used, written = real_paths([*read, *filter(None, more)]), real_paths(taken)
        for option, (target, what) in targets.items():
            real = os.path.realpath(target)
            if real in written:
                raise OutputError(f"{target}: two results would be one file; name another with {option}")
            written.add(real)
            if what:
                check_file(target, what, used, option=option)

    def jobs(self, files: Sequence[Files | OutputError] = ()) -> list[Job]:
        """Return the jobs, with the files of each, if it has some, or why they cannot be written.

        ImageError if a table of times lacks one.
        """
        sources, table = self.inputs.sources, self.in_time.timestamps
        if table is not None:
            named = [one.path if one.frame is None else one.name for one in sources]
            times = timestamps_of(named, table)
            sources = [replace(one, time_s=time) for one, time in zip(sources, times, strict=True)]
        near, names, jobs = neighbours_of(sources, self.in_time.sequence), self.inputs.names(), []
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
        earlier: Earlier,
        *,
        classify: Callable[[Photograph], Photograph] = lambda photograph: photograph,
        show: Callable[[Job, Outcome], str | None] = lambda job, outcome: outcome.summary,
        keeps: bool = True,
        total: bool = True,
    ) -> Finished:
        """Return what came of all photographs in order, after printing a line for each and writing the table.

        Ends early, after a line that says how to go on, if it is interrupted, no photograph can be done any
        more, as on a full disk, or as many failed as --max-failures allows. ``classify`` returns the record
        of each with what it is of use for, ``show`` what is printed of it, None for nothing; ``keeps`` says
        whether the outcomes are needed in the end, ``total`` whether a closing line is wanted.
        """
        run, warned, start = Finished(), set[str](), time.monotonic()
        records: list[Photograph] = []
        sends, about = self.many.dask is not None, "" if self.printing.quiet else self.inputs.counted
        do = self._executor(len(jobs))
        results = outcomes(work, jobs, do, find=earlier.find, keep=earlier.keep, sends=sends)
        try:
            with progress(len(jobs), about) as (say, advance), closing(results):
                for job, outcome in results:
                    if len(run.failures) == self.many.max_failures:  # and there is another one
                        run.end = End.STOPPED
                        break
                    outcome = replace(outcome, photograph=classify(outcome.photograph))
                    self._say(job, outcome, show(job, outcome), say, warned, alone=len(jobs) == 1)
                    run.count += 1
                    run.skipped += outcome.skipped
                    run.failures += [{"image": str(job.source), "error": outcome.error}] * bool(outcome.error)
                    run.outcomes += [(job, outcome)] * keeps
                    records += [outcome.photograph] * (self.table is not None and not is_folder(job))
                    advance()
                    if outcome.stop:
                        run.end = End.STOPPED
                        break
        except KeyboardInterrupt:
            run.end = End.INTERRUPTED
        except (RunError, OutputError) as error:  # no cluster, or no journal, any more; it says how to go on
            complain(error)
            run.end = End.BROKEN
        run.seconds = time.monotonic() - start
        resumes = earlier.journal is not None or any(job.files for job in jobs)
        self._print_end(run, len(jobs), total=total, resumes=resumes)
        run.has_table = self._write_table(records)
        return run

    def _executor(self, count: int) -> Executor:
        """Return what does so many jobs: a cluster, or processes."""
        if self.many.dask is None:
            return executor(max(min(self.many.jobs or usable_cores(), count), 1))
        from blur2view.runs.cluster import Cluster

        return Cluster(self.many.dask)

    def _say(
        self, job: Job, outcome: Outcome, text: str | None, say: Say, warned: set[str], *, alone: bool
    ) -> None:
        """Print what became of a photograph: why it failed, or the text; warnings.

        One about each option: of most photographs it is the same.
        """
        quiet, verbose = self.printing.quiet, self.printing.verbose
        if outcome.error:
            complain(Blur2ViewError(outcome.error), say)
        elif text is not None and not quiet and (not outcome.skipped or verbose):
            lines = text.split("\n") if alone or verbose else [text.partition("\n")[0]]
            say("\n".join(map(printable, lines)))
        for warning in outcome.warnings:
            if (about := warning.partition(" ")[0]) not in warned and not quiet:
                complain(Blur2ViewError(f"{job.source}: {warning}"), say)
            warned.add(about)

    def _write_table(self, records: Sequence[Photograph]) -> bool:
        """Return whether the table could be written, if one is wanted; the others are of use without it."""
        try:
            if self.table is not None and records:
                write_file(self.table, table_text(records), sealed=True)
        except OutputError as error:
            complain(error)
            return False
        return True

    def _print_end(self, run: Finished, count: int, *, total: bool, resumes: bool) -> None:
        """Print the total of several photographs, if it is wanted, or why a run ended early."""
        if run.end is End.WHOLE and count > 1 and total and not self.printing.quiet:
            failed, skipped = len(run.failures), run.skipped  # a video may have fewer frames than it says
            done = run.count - skipped - failed
            parts = [f"{done} done"] if done or not (skipped or failed) else []
            parts += [f"{skipped} done before"] * bool(skipped) + [f"{failed} failed"] * bool(failed)
            rate = f", {done / run.seconds:.2g} a second" if done and run.seconds > 0 else ""
            print(f"{plural(count, 'photograph')}: {', '.join(parts)} in {run.seconds:.1f} s{rate}")
        elif run.end is End.INTERRUPTED or (run.end is End.STOPPED and count > 1):
            line = f"blur2view: {run.end.name.lower()}"
            if count > 1:
                line += f" after {run.count} of {plural(count, 'photograph')}"
                line += "; what is done is kept, the same call with --resume goes on" * resumes
            print(line, file=sys.stderr, flush=True)


def is_folder(job: Job) -> bool:
    """Return whether a job is no photograph but a folder that cannot be used."""
    return job.refusal is not None and job.source.path.is_dir()
