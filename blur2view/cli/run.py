"""A command over photographs: what it writes is checked before any work; done, printed, written."""

import json
import os
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from blur2view.cli.options import Command
from blur2view.cli.terminal import DONE, FAILED, INTERRUPTED, complain, plural, printable, show_status
from blur2view.cli.work import digest_of, network_of
from blur2view.errors import Blur2ViewError, ImageError, OutputError, RunError
from blur2view.images.inputs import Source
from blur2view.networks.model_file import usable_cores
from blur2view.output_files import check_file, real_paths, writable_folders, write_file
from blur2view.results.photograph import Photograph, table_text
from blur2view.runs.executors import in_cluster, in_processes
from blur2view.runs.jobs import Job, Outcome, neighbours_of

FAILURES = {"failures": "(list) Photographs that failed: image, error."}


@dataclass(kw_only=True, eq=False)
class Finished:
    """What came of a run over photographs, in their order, as far as it has come."""

    outcomes: list[tuple[Job, Outcome]] = field(default_factory=list)
    ended_early: int = DONE  # the exit code, if it was interrupted or no photograph can be done any more
    seconds: float = 0.0
    without_table: bool = False  # as it could not be written

    @property
    def records(self) -> dict[Job, Photograph]:
        """The records of all, but of what was refused before it was read."""
        return {job: one.photograph for job, one in self.outcomes if job.refusal is None}

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
        return self.ended_early or (FAILED if self.failures or self.without_table else DONE)


class Photographs:
    """The photographs of a command with these options, and how it goes through them."""

    def __init__(self, options: Command) -> None:
        self.options = options
        self.inputs = options.common.reading.inputs()
        self.folder = options.results_folder

    def jobs(
        self, endings: Sequence[str] = (), beside: Callable[[Path], Sequence[Path]] = lambda name: ()
    ) -> list[Job]:
        """Return the jobs, with the files of each if a folder of results is named.

        They are called by the photograph's stem and these ``endings``, in the order of writing, JSON last;
        ``beside`` gives further files of a photograph by its name, below the folder. Inputs and files of
        other programs are never replaced, nor results of another photograph of the call: that is refused.
        """
        inputs, read, first_of = self.inputs, self.inputs.read, dict[Path, Source]()
        digest = digest_of(self.options)
        near, jobs = neighbours_of(inputs.sources, self.options.timing.sequence), list[Job]()
        named = zip(inputs.sources, inputs.names(), inputs.result_names(), strict=True)
        for beside_it, (source, name, stem) in zip(near, named, strict=True):
            files: tuple[Path, ...] = ()
            refusal: Blur2ViewError | None = None
            if source.refusal:
                refusal = ImageError(source.refusal)
            elif self.folder.output is not None:
                own = (Path(f"{stem}{ending}") for ending in endings)
                files = tuple(self.folder.output / path for path in (*beside(Path(name)), *own))
                refusal = _conflict(source, files, read, first_of)
            job = Job(source=source, name=name, neighbours=beside_it, options_sha256=digest)
            jobs.append(replace(job, files=files, refusal=refusal))
        return jobs

    @contextmanager
    def writing(
        self, jobs: Iterable[Job], beside: Path | None = None, **targets: Path | None
    ) -> Iterator[None]:
        """Check all that the call writes, before any work; at the end remove folders that stayed empty.

        The network is loaded. ``targets`` are files of all photographs by their options, besides the table;
        ``beside`` is one more that the call checks itself. ModelError or OutputError of what cannot be used.
        """
        network_of(self.options)  # first, so that a damaged one is named before any photograph
        every = targets | {"csv": self.options.common.csv}
        written = {f"--{option}": path for option, path in every.items() if path is not None}
        paths = [path for job in jobs for path in job.files] + [one for one in [beside] if one is not None]
        names, database = real_paths(paths), self.options.common.lens.database
        used = self.inputs.read | real_paths([] if database is None else [database])
        folders = {path.parent for path in (*paths, *written.values())}
        with writable_folders(*sorted(folders)):
            for option, target in written.items():
                if (real := os.path.realpath(target)) in names:
                    raise OutputError(f"{target}: two results would be one file; name another with {option}")
                names.add(real)
                check_file(target, used, option=option)
            yield

    def run(
        self, jobs: Sequence[Job], work: Callable[[Any, Any], Outcome], *, lines: bool = True
    ) -> Finished:
        """Return what came of all photographs in order, after printing a line for each.

        Ends early, after a line that says how to go on, if it is interrupted or no photograph can be done any
        more, as on a full disk. ``work`` takes the options and a job.
        """
        run, start, many = Finished(), time.monotonic(), self.options.common.many
        do = partial(in_processes, count=max(min(many.jobs or usable_cores(), len(jobs)), 1))
        if many.dask is not None:
            do = partial(in_cluster, address=many.dask)
        find = self._done_before if self.folder.resume else lambda job: None
        try:
            with closing(do(partial(work, self.options), jobs, find)) as results:
                for job, outcome in results:
                    run.outcomes.append((job, outcome))
                    show_status()
                    self._print(outcome, lines=lines and not self.folder.json, alone=len(jobs) == 1)
                    if len(jobs) > 1:
                        show_status(f"{len(run.outcomes)} of {plural(len(jobs), 'photograph')}")
        except KeyboardInterrupt:
            run.ended_early = INTERRUPTED
        except (RunError, OutputError) as error:
            complain(error)
            run.ended_early = FAILED
        finally:
            show_status()
        run.seconds = time.monotonic() - start
        if run.ended_early == INTERRUPTED or (run.ended_early and len(jobs) > 1):
            line = "interrupted" if run.ended_early == INTERRUPTED else "stopped"
            if len(jobs) > 1:
                line += f" after {len(run.outcomes)} of {plural(len(jobs), 'photograph')}"
                line += "; the same call with --resume does the rest" * any(job.files for job in jobs)
            print(f"blur2view: {line}", file=sys.stderr, flush=True)
        return run

    def _done_before(self, job: Job) -> Outcome | None:
        """Return the outcome of a photograph whose results are of the same input and options."""
        try:
            record = Photograph.from_json(job.files[-1].read_bytes())
            record.to_json()  # with all that is derived
        except (
            OSError,
            ValueError,
            TypeError,
            LookupError,
            AttributeError,
            RecursionError,
        ):  # cut or changed
            return None
        same = (record.input_sha256, record.options_sha256) == (job.input_sha256, job.options_sha256)
        if not same or not all(path.is_file() for path in job.files):
            return None
        summary = f"{printable(str(job.source))}: done before"
        return Outcome(photograph=replace(record, name=job.name), summary=summary, skipped=True)

    def _print(self, one: Outcome, *, lines: bool, alone: bool) -> None:
        """Print what became of a photograph: why it failed, or its summary, whole if it is alone."""
        printing = self.options.common.printing
        whole = alone or printing.verbose
        if one.error:
            complain(Blur2ViewError(one.error))
        elif lines and not printing.quiet and (whole or not one.skipped):
            summary = one.summary.split("\n")
            print("\n".join(map(printable, summary if whole else summary[:1])), flush=True)

    def close(self, run: Finished, listed: str = "", *, total: bool = True) -> None:
        """Print the records as one list of this name, if it is asked for; write the table.

        Else a ``total`` says how many of several photographs were done, and what was written. A table that
        cannot be written is one line of failure: all else is of use without it.
        """
        if self.folder.json:
            done = [one.photograph.plain() for one in run.done]
            print(json.dumps({listed: done, "failures": run.failures}, indent=2, allow_nan=False))
        table, rows = self.options.common.csv, list(run.records.values())
        if table is not None and rows:
            try:
                write_file(table, table_text(rows))
            except OutputError as error:
                complain(error)
                run.without_table, table = True, None
        quiet = self.options.common.printing.quiet or self.folder.json
        if run.ended_early or len(run.outcomes) < 2 or quiet or not total:
            return
        skipped, failed = sum(one.skipped for one in run.done), len(run.failures)
        counts = {"done": len(run.done) - skipped, "done before": skipped, "failed": failed}
        parts = ", ".join(f"{count} {words}" for words, count in counts.items() if count)
        line = f"{plural(len(run.outcomes), 'photograph')}: {parts} in {run.seconds:.1f} s"
        paths = [printable(str(path)) for path in (self.folder.output, table) if path is not None]
        print(line + f"; wrote {' and '.join(paths)}" * bool(paths and counts["done"]))


def _conflict(
    source: Source, files: Sequence[Path], read: Collection[str], first_of: dict[Path, Source]
) -> OutputError | None:
    """Return why the files of a photograph must not be written, if so; note whose they are."""
    try:
        for path in files:
            check_file(path, read)
            if (other := first_of.setdefault(path, source)) != source:
                raise OutputError(f"its results would be those of {other}; use another -o")
    except OutputError as error:
        return OutputError(f"{source}: {error}")
    return None


def wrote(job: Job, endings: Sequence[str]) -> str:
    """Return what a summary says of a photograph's files, if it has some."""
    if not job.files:
        return ""
    name = printable(str(job.files[-1]).removesuffix(endings[-1]))
    listed = ",".join(ending.removeprefix(".") for ending in reversed(endings))
    others = [printable(str(path)) for path in job.files[: -len(endings)]]
    return "; wrote " + ", ".join([f"{name}.{{{listed}}}", *others])
