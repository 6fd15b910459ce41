"""A command over photographs: it checks what it writes, then does, prints and writes each photograph."""

import hashlib
import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from blur2view import __version__
from blur2view.cli.batch.job import Done, Job, Outcome, neighbours_in_time
from blur2view.cli.batch.photograph import features_in, open_network
from blur2view.cli.batch.schedule import combined_digest, in_cluster, in_processes
from blur2view.cli.options import STANDARD_OUTPUT, Command
from blur2view.cli.terminal import DONE, FAILED, INTERRUPTED, complain, plural, printable, waiting
from blur2view.errors import Blur2ViewError, ImageError, OutputError, RunError
from blur2view.files import file_digest, read_regular
from blur2view.images.inputs import Source
from blur2view.networks.model_file import model_path, usable_cores
from blur2view.output import check_file, real_paths, writable_folder, write_file
from blur2view.records.record import Record, table_text

FAILURES = {"failures": "(list) Photographs that failed: image, error."}


class Run:
    """The photographs of one call of a command, and what has come of them so far, in order.

    The results of a photograph are called by its stem and the ``endings``, in the order of writing, JSON
    last; ``beside`` gives further files of a photograph by its name, below the folder of results. Inputs,
    files of other programs and results of another photograph are never replaced: that is refused.
    """

    def __init__(
        self,
        options: Command,
        endings: Sequence[str] = (),
        beside: Callable[[Path], Sequence[Path]] = lambda name: (),
    ) -> None:
        self.options, self.inputs = options, options.reading.inputs()
        self.jobs: Sequence[Job] = list(self._jobs(endings, beside))
        self.looked_at: Iterable[Job] | None = None  # those of the jobs that a command chooses, if it does
        self.passed: Callable[[Job, Outcome], None] | None = None  # sees each job with its content, in order
        self.outcomes: list[tuple[Job, Outcome]] = []
        self.frames_by_reason = Counter[tuple[Path, str]]()  # that failed, by their video and the reason
        self.early_exit_code = DONE  # another one if it was interrupted or nothing can be done any more
        self.seconds = 0.0
        self.table: Path | None = None  # once it is written
        self.without_table = False  # because it could not be written

    @property
    def noun(self) -> str:
        """What the photographs are called: frames, if all are those of videos."""
        return "frame" if all(job.source.frame is not None for job in self.jobs) else "photograph"

    @property
    def done(self) -> list[Outcome]:
        """The outcomes that are not failures."""
        return [outcome for _, outcome in self.outcomes if not outcome.error]

    @property
    def records(self) -> list[Record]:
        """The rows of the table: the records of all photographs but those that were refused before."""
        return [outcome.record for job, outcome in self.outcomes if job.refusal is None]

    @property
    def failures(self) -> list[dict[str, str]]:
        """What failed: image and error."""
        failed = [(job, outcome.error) for job, outcome in self.outcomes if outcome.error]
        return [{"image": str(job.source), "error": error} for job, error in failed]

    @property
    def exit_code(self) -> int:
        """The exit code: 0 done, 1 something failed, 130 interrupted."""
        return self.early_exit_code or (FAILED if self.failures or self.without_table else DONE)

    def _jobs(self, endings: Sequence[str], beside: Callable[[Path], Sequence[Path]]) -> Iterator[Job]:
        """Yield a job for each photograph, with its files if a folder of results is named."""
        inputs, folder, digest = self.inputs, self.options.folder.output, options_digest(self.options)
        input_files, source_by_file = inputs.read, dict[Path, Source]()
        neighbours_of_each = neighbours_in_time(inputs.sources, self.options.order.sequence)
        entries = zip(inputs.sources, inputs.names(), inputs.result_names(), neighbours_of_each, strict=True)
        for source, name, stem, neighbours in entries:
            files: list[Path] = []
            refusal: Blur2ViewError | None = None
            if source.refusal:
                refusal = ImageError(source.refusal)
            elif folder is not None:
                results = [Path(f"{stem}{ending}") for ending in endings]
                files = [folder / path for path in (*beside(Path(name)), *results)]
            for path in files:
                try:
                    check_file(path, input_files)
                except OutputError as error:
                    refusal = error
                if (other := source_by_file.setdefault(path, source)) != source:
                    both = f"{other} and {source}"
                    refusal = OutputError(f"{path}: would hold results of {both}; give each another -o")
            yield Job(
                source=source,
                name=name,
                files=tuple(files),
                neighbours=neighbours,
                refusal=refusal,
                call_sha256=digest,
            )

    def do(
        self,
        work: Callable[[Any, Any], Outcome],
        print_outcome: Callable[["Run", Outcome], None],
        *,
        checked: Path | None = None,
        **targets: Path | None,
    ) -> None:
        """Do all photographs in order, after a check of all that is written, and write the table.

        ``work`` takes the options and a job; ``print_outcome`` prints an outcome, above the bar, as it comes.
        ``targets`` are files of all photographs by their options; ``checked`` is one that the command checks
        itself. It ends early, after a line that says how to go on, if it is interrupted or nothing can be
        done any more, as on a full disk. ModelError or OutputError of what cannot be used.
        """
        self._check(targets, checked)
        self._name_ignored()
        start, count = time.monotonic(), len(self.jobs)
        number_by_source = {job.source: number for number, job in enumerate(self.jobs, 1)}
        try:
            with waiting(f"{self.noun}s", hidden=self.options.printing.quiet) as show:
                show(0, count)
                with closing(self._results(work)) as results:
                    for job, outcome in results:
                        if self.passed is not None:
                            self.passed(job, outcome)
                        self.outcomes.append((replace(job, content=None), outcome))
                        if outcome.error and job.source.frame is not None:
                            self.frames_by_reason[self.reason_of_last()] += 1
                        print_outcome(self, outcome)
                        show(number_by_source[job.source], count)
                        del job  # with its content
        except KeyboardInterrupt:
            self._end_early(INTERRUPTED, "interrupted")
        except (RunError, OutputError) as error:
            complain(error)
            self._end_early(FAILED, "stopped")
        self.seconds = time.monotonic() - start
        self._count_alike()
        self._write_table()

    def reason_of_last(self) -> tuple[Path, str]:
        """Return the folder or video of what came last, and why it failed, without its name."""
        job, outcome = self.outcomes[-1]
        return job.source.folder, outcome.error.replace(str(job.source), "")

    def _count_alike(self) -> None:
        """Print how many frames of a video failed as one that was named; with -v each was."""
        for (video, _), count in self.frames_by_reason.items():
            if count > 1 and not self.options.printing.verbose:
                complain(
                    RunError(f"{video}: {plural(count - 1, 'more frame')} failed for the same reason (-v)")
                )

    def _check(self, targets: Mapping[str, Path | None], checked: Path | None) -> None:
        """Load the network, and check all that the call writes, so that errors come before any work."""
        open_network(self.options.estimating)
        all_targets = {**targets, "csv": self.options.table.csv}
        target_by_option = {
            f"--{option}": path
            for option, path in all_targets.items()
            if path is not None and path != STANDARD_OUTPUT
        }
        paths = [path for job in self.jobs for path in job.files]
        paths += [] if checked is None else [checked]
        database = self.options.stated_camera.database
        names, used = real_paths(paths), self.inputs.read | real_paths([] if database is None else [database])
        for option, target in target_by_option.items():
            if (real := os.path.realpath(target)) in names:
                raise OutputError(f"{target}: two results would be one file; name another with {option}")
            names.add(real)
            check_file(target, used, option=option)
        folders = {str(folder) for name in names for folder in Path(name).parents}
        for option, target in target_by_option.items():
            if os.path.realpath(target) in folders:
                raise OutputError(
                    f"{target}: is the folder of other results; name another file with {option}"
                )
        for folder in sorted({path.parent for path in (*paths, *target_by_option.values())}):
            writable_folder(folder)

    def _name_ignored(self) -> None:
        """Print which options are for videos alone where none is named, and which videos are not read."""
        if self.options.printing.quiet:
            return
        reading = self.options.reading
        is_given_by_option = {
            "--every": reading.every > 1,
            "--from": reading.first > 0,
            "--to": reading.last is not None,
        }
        of_frames = [option for option, is_given in is_given_by_option.items() if is_given]
        sources = [job.source for job in self.jobs]
        if of_frames and all(map(_is_photograph, sources)):
            said = f"{', '.join(of_frames)}: no video is named whose frames could be chosen"
            complain(RunError(f"{said}; all photographs are read"))
        if videos := self.inputs.passed_over:
            more = f" and {len(videos) - 1} more" if len(videos) > 1 else ""
            what = "a video beside photographs is" if not more else "videos beside photographs are"
            complain(RunError(f"{videos[0]}{more}: {what} not read; name it to read its frames"))

    def _results(self, work: Callable[[Any, Any], Outcome]) -> Done:
        """Return a generator of the jobs with their outcomes."""
        many, find = self.options.many, self._done_before if self.options.folder.resume else lambda job: None
        do, look = partial(work, self.options), partial(features_in, self.options.as_stored)
        jobs = self.jobs if self.looked_at is None else self.looked_at
        if many.dask is not None:
            return in_cluster(do, jobs, find, look, address=many.dask)
        count = max(min(many.jobs or usable_cores(), len(self.jobs)), 1)
        return in_processes(do, jobs, find, look, count=count)

    def _done_before(self, job: Job) -> Outcome | None:
        """Return the outcome of a photograph whose files are there, from the same input and options."""
        try:
            record = Record.from_json(job.files[-1].read_bytes())
            record.to_json()  # with all that is derived
            is_complete = record.files_sha256 == combined_digest(map(read_regular, job.files[:-1]))
        except (OSError, ValueError, TypeError, LookupError, AttributeError, RecursionError):
            return None  # none, or cut off, or changed
        same = (record.input_sha256, record.options_sha256) == (job.input_sha256, job.job_sha256)
        if not same or not is_complete:
            return None
        summary = f"{printable(job.name)}: done before"
        return Outcome(record=replace(record, name=job.name), summary=summary, skipped=True)

    def _end_early(self, code: int, line: str) -> None:
        """Note the exit code of a run that ends early, and say what does the rest."""
        self.early_exit_code, count = code, len(self.jobs)
        if count > 1:
            line += f" after {len(self.outcomes)} of {plural(count, self.noun)}"
            if any(job.files for job in self.jobs):
                line += "; the same call with --resume does the rest"
        if count > 1 or code == INTERRUPTED:
            complain(RunError(line))

    def _write_table(self) -> None:
        """Write the table; one that cannot be written is one line, because the rest is of use."""
        table = self.options.table.csv
        if table not in (None, STANDARD_OUTPUT) and self.records:
            try:
                write_file(table, table_text(self.records, self.options.columns), noted=True)
                self.table = table
            except OutputError as error:
                complain(error)
                self.without_table = True


def _is_photograph(source: Source) -> bool:
    """Return whether a source is a photograph, and not a video, also one without such frames."""
    return source.frame is None and not source.refusal and source.path.is_file()


def wrote(job: Job, endings: Sequence[str]) -> str:
    """Return the end of a summary, which names the photograph's files; empty without files."""
    if not job.files:
        return ""
    name = printable(str(job.files[-1]).removesuffix(endings[-1]))
    suffixes = ",".join(ending.removeprefix(".") for ending in reversed(endings))
    others = [printable(str(path)) for path in job.files[: -len(endings)]]
    return "; wrote " + ", ".join([f"{name}.{{{suffixes}}}", *others])


def options_digest(options: Command) -> str:
    """Return the SHA-256 of all that results depend on besides photographs: options, network, version.

    Those options are the groups of the camera, of the estimate and of time, and a command's own but paths.
    """
    files = model_path(options.estimating.model), options.stated_camera.database
    digests = [file_digest(file) if file is not None and file.is_file() else "" for file in files]
    names = [option.name for option in fields(options) if option.metadata and "Path" not in str(option.type)]
    own_options = {name: getattr(options, name) for name in names}
    groups = options.stated_camera, options.estimating, options.order, options.in_time
    parts = type(options).__name__, __version__, digests, groups, own_options
    return hashlib.sha256(repr(parts).encode()).hexdigest()
