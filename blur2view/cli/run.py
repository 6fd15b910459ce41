"""A command over many photographs: checked before any work, done, printed and written down."""

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, fields, replace
from enum import Enum, auto
from pathlib import Path

from blur2view import __version__
from blur2view.cli.arguments.shared import PhotographOptions
from blur2view.cli.terminal import Say, complain, plural, printable, progress
from blur2view.cli.work import network_of
from blur2view.colmap.cameras import StoredCamera
from blur2view.errors import Blur2ViewError, ImageError, OutputError, RunError
from blur2view.images.inputs import colmap_names
from blur2view.images.timestamps import timestamps_of
from blur2view.input_files import read_regular
from blur2view.networks.model_file import usable_cores
from blur2view.output_files import check_file, real_paths, writable_folders, write_file
from blur2view.results.table import Row, table_text
from blur2view.runs.job import Job, Outcome, file_digest, neighbours_of
from blur2view.runs.manifest import Manifest, opened
from blur2view.runs.processes import Engine, processes
from blur2view.runs.run import outcomes

DONE, FAILED, INTERRUPTED = 0, 1, 130
LISTS = "--keep", "--keep-for-poses", "--keep-for-training"
Files = tuple[Path, ...]
WHAT = {"--csv": "table", "-o": "page"} | dict.fromkeys(LISTS, "list")  # is written, by its option


class End(Enum):
    """How a run ended: after all photographs, by too many failures, by Ctrl-C, or as none can be done."""

    WHOLE = auto()
    STOPPED = auto()
    INTERRUPTED = auto()
    BROKEN = auto()  # then files of all photographs, but for the table, stay as an earlier call left them


@dataclass(kw_only=True, eq=False)
class Finished:
    """What came of a run over photographs, in their order, as far as it has come."""

    outcomes: list[tuple[Path, Outcome]] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)  # of the table
    end: End = End.WHOLE
    has_table: bool = True  # it was not asked for, or could be written
    seconds: float = 0.0

    @property
    def failures(self) -> list[dict[str, str]]:
        """The photographs that failed, as documents have them."""
        return [{"image": str(path), "error": one.error} for path, one in self.outcomes if one.error]

    @property
    def skipped(self) -> int:
        """How many photographs an earlier call has done."""
        return sum(one.skipped for _, one in self.outcomes)

    @property
    def exit_code(self) -> int:
        """Return the exit code: 0 done, 1 something failed, 130 interrupted."""
        if self.end is End.INTERRUPTED:
            return INTERRUPTED
        return FAILED if self.failures or self.end is End.BROKEN or not self.has_table else DONE


@contextmanager
def open_manifest(options: PhotographOptions, others: Iterable[Path] = ()) -> Iterator[Manifest | None]:
    """Load the network, open the manifest, which no other call has then, and check what the call writes.

    None if nothing is written down. ``others`` are files that it writes besides its targets.
    """
    network_of(options.model, options.provider, options.digest)  # which is named first if it is none
    path, folders = options.manifest_path, {one.parent for one in options.targets.values()}
    with (
        writable_folders(*folders),
        nullcontext() if path is None else _opened(options, path, folders) as manifest,
    ):
        if manifest is not None and manifest.complaint is not None:
            complain(manifest.complaint)
        _check_targets(options, manifest, (*others, *filter(None, [path])))
        yield manifest


def _opened(options: PhotographOptions, path: Path, folders: set[Path]) -> AbstractContextManager[Manifest]:
    """Open the manifest at a path, with all that results depend on beside their photographs."""
    camera = options.run.intrinsics.camera
    files = [camera.database] if isinstance(camera, StoredCamera) else []
    digests = {
        "network": options.digest,
        "camera_files": [file_digest(one) for one in files if one.is_file()],
    }
    of_result = [one.name for one in fields(options) if one.metadata.get("result")]
    return opened(
        path,
        command=options.command,
        version=__version__,
        options={name: getattr(options, name) for name in of_result} | digests,
        resume=options.resume,
        folders={path.parent, *folders},
    )


def _check_targets(options: PhotographOptions, manifest: Manifest | None, others: Iterable[Path]) -> None:
    """Refuse a file of all photographs that would replace what it must not, or be one with another.

    It may replace what a manifest, or the file itself, says that an earlier call wrote. With --overwrite and
    --resume that is a list that was changed since, too, if it names nothing but these photographs.
    """
    names = set(colmap_names(options.inputs).values())
    again = options.overwrite or options.resume or len(names) == 1
    photographs, lists, taken = (
        real_paths(paths) for paths in (options.inputs.paths, options.inputs.lists, others)
    )
    for name, target in options.targets.items():
        real = os.path.realpath(target)
        if real in taken:
            raise OutputError(f"{target}: two results would be one file; name another with {name}")
        if real in lists:
            raise OutputError(f"{target}: names the photographs of this call; name another with {name}")
        taken.add(real)
        wrote = (manifest is not None and manifest.wrote(target)) or (again and _names_only(target, names))
        if name in WHAT and not wrote:
            check_file(target, WHAT[name], photographs, option=name)


def _names_only(target: Path, names: set[str]) -> bool:
    """Return whether a file is a list of nothing but these names."""
    with suppress(OSError, ValueError):
        return set(read_regular(target).decode().splitlines()) <= names
    return False


def run_over(
    options: PhotographOptions,
    jobs: Sequence[Job],
    manifest: Manifest | None,
    *,
    classify: Callable[[Row], Row] = lambda row: row,
    line: Callable[[Path, Row], str] | None = None,
) -> Finished:
    """Return what came of all photographs, in order, after printing a line for each and writing the table.

    Ends early, after a line that says how to go on, if it is interrupted, no photograph can be done any more,
    as on a full disk, or as many failed as --max-failures allows. ``classify`` adds to a row what the
    photograph is of use for, ``line`` returns what is printed of it: by default the summary of the work, and
    a closing line.
    """
    run, warned, start, refused = Finished(), set[str](), time.monotonic(), options.inputs.refused
    failed = 0
    begun = [
        replace(job, refusal=ImageError(refused[job.path])) if job.path in refused else job for job in jobs
    ]
    results = outcomes(options, begun, _engine(options, len(jobs)), manifest, sends=options.dask is not None)
    about = "" if options.quiet else options.inputs.counted
    try:
        with progress(len(jobs), about) as (say, advance), closing(results):
            for job, outcome in results:
                if failed == options.max_failures:  # and there is another one
                    run.end = End.STOPPED
                    break
                row = classify(replace(outcome.row, name=job.name, use="", error=outcome.error))
                text = line(job.path, row) if line else outcome.summary
                whole = len(jobs) == 1 or options.verbose
                _say(options, job, outcome, text if whole else text.partition("\n")[0], say, warned)
                run.rows += [] if options.inputs.is_folder(job.path) else [row]
                run.outcomes.append((job.path, outcome if options.keeps else replace(outcome, payload=None)))
                failed += bool(outcome.error)
                advance()
                if outcome.stop:
                    run.end = End.STOPPED
                    break
    except KeyboardInterrupt:
        run.end = End.INTERRUPTED
    except (RunError, OutputError) as error:  # no cluster, or no manifest, any more; it says how to go on
        complain(error)
        run.end = End.BROKEN
    run.has_table, run.seconds = _write_table(options.csv, run.rows), time.monotonic() - start
    _print_end(run, len(jobs), manifest, total=options.prints and line is None)
    return run


def _engine(options: PhotographOptions, count: int) -> Engine:
    """Return what does so many jobs: a cluster, or processes."""
    if options.dask is None:
        return processes(max(min(options.jobs or usable_cores(), count), 1))
    from blur2view.runs.cluster import Cluster

    return Cluster(options.dask)


def _say(
    options: PhotographOptions, job: Job, outcome: Outcome, text: str, say: Say, warned: set[str]
) -> None:
    """Print what became of a photograph: why it failed, or the text; with --jsonl its document; warnings.

    One about each option: of most photographs it is the same.
    """
    if outcome.error:
        complain(Blur2ViewError(outcome.error), say)
    elif options.prints and (not outcome.skipped or options.verbose):
        say("\n".join(map(printable, text.split("\n"))))  # a manifest's may hold anything
    if options.jsonl:
        failure = {"image": str(job.path), "error": outcome.error}
        print(json.dumps(failure if outcome.error else outcome.payload, allow_nan=False), flush=True)
    for warning in outcome.warnings:
        if (about := warning.partition(" ")[0]) not in warned and not options.quiet:
            complain(Blur2ViewError(f"{job.path}: {warning}"), say)
        warned.add(about)


def _write_table(target: Path | None, rows: Sequence[Row]) -> bool:
    """Return whether the table could be written, if one is wanted; the others are of use without it."""
    try:
        if target is not None and rows:
            write_file(target, table_text(rows))
    except OutputError as error:
        complain(error)
        return False
    return True


def _print_end(run: Finished, count: int, manifest: Manifest | None, *, total: bool) -> None:
    """Print the total of several photographs, if it is wanted, or one line about a run that ended early."""
    if run.end is End.WHOLE and count > 1 and total:  # a video may have fewer frames than it says
        skipped, failed = run.skipped, len(run.failures)
        done = len(run.outcomes) - skipped - failed
        parts = [f"{done} done"] if done or not (skipped or failed) else []
        parts += [f"{skipped} done before"] * bool(skipped) + [f"{failed} failed"] * bool(failed)
        rate = f", {done / run.seconds:.2g} a second" if done and run.seconds > 0 else ""
        print(f"{plural(count, 'photograph')}: {', '.join(parts)} in {run.seconds:.1f} s{rate}")
    elif run.end is End.INTERRUPTED or (run.end is End.STOPPED and count > 1):
        line = f"blur2view: {run.end.name.lower()}"
        if count > 1:
            line += f" after {len(run.outcomes)} of {plural(count, 'photograph')}"
            line += "; what is done is kept, the same call with --resume goes on" if manifest else ""
        print(line, file=sys.stderr)


def jobs_of(options: PhotographOptions, plan: Sequence[Files | OutputError] = ()) -> list[Job]:
    """Return the jobs of a command, with the files of each, if it has some, or why they cannot be written."""
    paths, table = options.inputs.paths, options.timestamps
    neighbours, names = neighbours_of(paths, options.sequence), colmap_names(options.inputs)
    times = [None] * len(paths) if table is None else timestamps_of(paths, table)
    jobs = []
    for index, (path, time_s) in enumerate(zip(paths, times, strict=True)):
        files = plan[index] if plan else ()
        refusal, files = (files, ()) if isinstance(files, OutputError) else (None, files)
        source = "" if table is None else f"{time_s}"
        job = Job(index=index, path=path, name=names[path], files=files, refusal=refusal)
        jobs.append(replace(job, neighbours=neighbours[path], timestamp_s=time_s, source=source))
    return jobs
