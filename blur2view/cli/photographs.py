"""A command over many photographs: what it writes is checked before any work, done, printed, noted."""

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from pathlib import Path
from typing import Any

from blur2view.cli.options import InTime, Many, Printing
from blur2view.cli.terminal import Say, complain, plural, printable, progress
from blur2view.cli.work import Setup
from blur2view.errors import Blur2ViewError, ImageError, OutputError, RunError
from blur2view.images.inputs import Inputs
from blur2view.images.timestamps import timestamps_of
from blur2view.networks.model_file import usable_cores
from blur2view.output_files import check_file, real_paths, write_file
from blur2view.results.photograph import Photograph, table_text
from blur2view.runs.executors import Executor, executor
from blur2view.runs.job import Job, Outcome, Work, identified, neighbours_of
from blur2view.runs.journal import Journal
from blur2view.runs.loop import Find, Keep, outcomes

DONE, FAILED, INTERRUPTED = 0, 1, 130
DAMAGE = (OSError, ValueError, TypeError, LookupError)
"""What reading a result may raise that was cut off, or changed."""
Files = tuple[Path, ...]


class End(Enum):
    """How a run ended: after all photographs, by too many failures, by Ctrl-C, or as none can be done."""

    WHOLE = auto()
    STOPPED = auto()
    INTERRUPTED = auto()
    BROKEN = auto()  # then files of all photographs stay as an earlier call left them


@dataclass(kw_only=True, eq=False)
class Finished:
    """What came of a run over photographs, in their order, as far as it has come."""

    jobs: list[Job] = field(default_factory=list)  # of the outcomes, if they are kept
    outcomes: list[Outcome] = field(default_factory=list)
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
class Photographs:
    """The photographs of a call, and how it goes through them.

    Parameters
    ----------
    inputs : Inputs
        The photographs.
    setup : Setup
        How each is estimated.
    many, printing : Many, Printing
        The options of these names.
    table : Path or None
        Where the table goes, if one is wanted.
    """

    inputs: Inputs
    setup: Setup
    many: Many
    printing: Printing
    table: Path | None = None

    @classmethod
    def of(cls, command: str, options: Any) -> "Photographs":
        """Return those of a command with these options, which have groups of the names used here."""
        return cls(
            inputs=options.reading.inputs(),
            setup=Setup.of(command, options),
            many=options.many,
            printing=options.printing,
            table=options.table.csv,
        )

    def jobs(self, in_time: InTime, files: Sequence[Files | OutputError] = ()) -> list[Job]:
        """Return the jobs, with the files of each, if it has some, or why they cannot be written.

        ImageError if a table of times lacks one.
        """
        sources = self.inputs.sources
        if in_time.timestamps is not None:
            times = timestamps_of(
                [one.name if one.frame is not None else one.path for one in sources], in_time.timestamps
            )
            sources = [replace(one, time_s=time) for one, time in zip(sources, times, strict=True)]
        near, names, jobs = neighbours_of(sources, in_time.sequence), self.inputs.names(), []
        for index, source in enumerate(sources):
            job = Job(index=index, source=source, name=names[index], neighbours=near[index])
            planned = files[index] if files else ()
            if source in self.inputs.refused:
                job = replace(job, refusal=ImageError(self.inputs.refused[source]))
            elif isinstance(planned, OutputError):
                job = replace(job, refusal=planned)
            else:
                job = replace(job, files=planned)
            jobs.append(job)
        return jobs

    def check(
        self, targets: Mapping[str, tuple[Path, str]], taken: Iterable[Path], *inputs: Path | None
    ) -> None:
        """Refuse, before any work, targets that would replace what they must not, or be one with another.

        ``targets`` are files of all photographs with what they are, by their options; ``taken`` further files
        that the call writes, ``inputs`` further ones that it reads. OutputError.
        """
        read = [*(one.path for one in self.inputs.sources), *self.inputs.lists, *filter(None, inputs)]
        used, written = real_paths(read), real_paths(taken)
        for option, (target, what) in targets.items():
            real = os.path.realpath(target)
            if real in written:
                raise OutputError(f"{target}: two results would be one file; name another with {option}")
            written.add(real)
            if what:
                check_file(target, what, used, option=option)

    def run(
        self,
        jobs: Sequence[Job],
        work: Work,
        *,
        find: Find = lambda job: None,
        keep: Keep = lambda job, outcome: None,
        classify: Callable[[Photograph], Photograph] = lambda photograph: photograph,
        show: Callable[[Job, Outcome], str | None] = lambda job, outcome: outcome.summary,
        keeps: bool = True,
        total: bool = True,
        resumes: bool = False,
    ) -> Finished:
        """Return what came of all photographs in order, after printing a line for each and writing the table.

        Ends early, after a line that says how to go on, if it is interrupted, no photograph can be done any
        more, as on a full disk, or as many failed as --max-failures allows. ``find`` and ``keep`` are as of
        `outcomes`; ``classify`` returns the record of each with what it is of use for, ``show`` what is
        printed of it, None for nothing; ``keeps`` says whether the outcomes are needed in the end, ``total``
        whether a closing line is wanted, ``resumes`` whether the same call could go on.
        """
        run, warned, start = Finished(), set[str](), time.monotonic()
        records: list[Photograph] = []
        about = "" if self.printing.quiet else self.inputs.counted
        results = outcomes(
            work, jobs, self._executor(len(jobs)), find=find, keep=keep, sends=self.many.dask is not None
        )
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
                    run.failures += [failure(job, outcome)] * bool(outcome.error)
                    if keeps:
                        run.jobs.append(job)
                        run.outcomes.append(outcome)
                    if self.table is not None and not is_folder(job):
                        records.append(outcome.photograph)
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
        self._print_end(run, len(jobs), total=total, resumes=resumes)
        run.has_table = self.write_table(records)
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

    def write_table(self, records: Sequence[Photograph]) -> bool:
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
                line += "; what is done is kept, the same call with --resume goes on" if resumes else ""
            print(line, file=sys.stderr, flush=True)


def is_folder(job: Job) -> bool:
    """Return whether a job is no photograph but a folder that cannot be used."""
    return job.refusal is not None and job.source.path.is_dir()


def failure(job: Job, outcome: Outcome) -> dict[str, str]:
    """Return what documents say of a photograph that failed."""
    return {"image": str(job.source), "error": outcome.error}


def found_file(setup: Setup, job: Job) -> Outcome | None:
    """Return what an earlier call made of a photograph, if its own JSON states the same input and options."""
    try:
        record = Photograph.from_json(job.files[-1].read_bytes())
        if _is_of(record, setup, job) and all(path.is_file() for path in job.files):
            return _found(job, record)
    except DAMAGE:
        pass
    return None


def found_line(journal: Journal, setup: Setup, job: Job) -> Outcome | None:
    """Return what an earlier call noted of a photograph with the same input and options."""
    job = identified(job)
    line = journal.find(_key(setup, job))
    if line is None:
        return None
    try:
        record = Photograph.from_json(json.dumps(line["photograph"]))
        return _found(job, record, line["besides"])
    except DAMAGE:
        return None


def note_line(journal: Journal, setup: Setup, job: Job, outcome: Outcome) -> None:
    """Note what was made of a photograph."""
    content = {"photograph": outcome.photograph.plain(), "besides": dict(outcome.besides)}
    journal.note(f"{outcome.photograph.input_sha256} {outcome.photograph.options_sha256}", content)


def _key(setup: Setup, job: Job) -> str:
    return f"{job.input_sha256} {setup.key(job)}"


def _is_of(record: Photograph, setup: Setup, job: Job) -> bool:
    job = identified(job)
    return f"{record.input_sha256} {record.options_sha256}" == _key(setup, job)


def _found(job: Job, record: Photograph, besides: Mapping[str, Any] | None = None) -> Outcome:
    return Outcome(
        photograph=replace(record, name=job.name),
        summary=f"{job.source}: done before",
        besides=besides or {},
        skipped=True,
    )
