"""A command over many photographs: checked before any work, done, printed and written down."""

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, fields, replace
from enum import Enum, auto
from functools import partial
from pathlib import Path

from blur2view import __version__
from blur2view.cli.arguments.shared import PhotographOptions
from blur2view.cli.terminal import Say, complain, plural, printable, progress
from blur2view.cli.work import network_of
from blur2view.colmap.cameras import StoredCamera
from blur2view.errors import Blur2ViewError, ImageError, OutputError, RunError
from blur2view.networks.model_file import usable_cores
from blur2view.output_files import ResultFiles, check_file, writable_folders, write_text
from blur2view.photographs.inputs import colmap_names
from blur2view.photographs.timestamps import timestamps_of
from blur2view.results.table import Row, table_text
from blur2view.runs.job import Job, Outcome, file_digest, neighbours_of
from blur2view.runs.manifest import ENDING, Manifest
from blur2view.runs.processes import Engine, processes
from blur2view.runs.run import outcomes

DONE, FAILED, INTERRUPTED = 0, 1, 130
Paths = Iterable[Path | None]


class End(Enum):
    """How a run ended: after all photographs, by too many failures, by Ctrl-C, or as none can be done."""

    WHOLE = auto()
    STOPPED = auto()
    INTERRUPTED = auto()
    BROKEN = auto()  # then files of all photographs, but for the table, stay as an earlier call left them


@dataclass(frozen=True, kw_only=True, eq=False)
class Finished:
    """What came of a run over photographs, in their order, as far as it has come."""

    outcomes: list[tuple[Path, Outcome]]
    rows: list[Row]  # of the table
    end: End
    has_table: bool  # it was not asked for, or could be written
    seconds: float

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
def open_manifest(
    options: PhotographOptions, path: Path | None, others: Paths = (), folders: Iterable[Path] = ()
) -> Iterator[Manifest | None]:
    """Load the network, check the table and open the manifest, which no other call has then.

    None if nothing is written down. ``path`` is that of the manifest, ``others`` what else the call writes;
    what is done is also looked up in the manifests in its folder and in further ``folders``.
    """
    network_of(options.model, options.provider, options.digest)  # which is named first if it is none
    if options.csv is not None:
        check_file(options.csv, "table", options.inputs.paths, option="--csv")
        refuse_shared(options, options.csv, (path, *others), "--csv")
    with writable_folders(options.csv and options.csv.parent):
        if path is None or not path.parent.is_dir():
            yield None
            return
        camera = options.run.intrinsics.camera
        files = [camera.database] if isinstance(camera, StoredCamera) and camera.database.is_file() else []
        digests = {"network": options.digest, "camera_files": [file_digest(file) for file in files]}
        of_result = [one.name for one in fields(options) if one.metadata.get("result")]
        values = {name: getattr(options, name) for name in of_result} | digests
        settings = partial(Manifest, command=options.command, version=__version__, options=values)
        with settings(path, resume=options.resume, folders={path.parent, *folders}) as manifest:
            if manifest.complaint is not None:
                complain(manifest.complaint)
            yield manifest


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
    refused = options.inputs.refused
    jobs = [
        replace(job, refusal=ImageError(refused[job.path])) if job.path in refused else job for job in jobs
    ]
    engine: Engine = processes(max(min(options.jobs or usable_cores(), len(jobs)), 1))
    if options.dask is not None:
        from blur2view.runs.cluster import Cluster

        engine = Cluster(options.dask)
    done: list[tuple[Path, Outcome]] = []
    rows: list[Row] = []
    failed, warned, end, start = 0, set[str](), End.WHOLE, time.monotonic()
    watched = progress(len(jobs), "" if options.quiet else options.inputs.counted)
    results = outcomes(options, jobs, engine, manifest, sends=options.dask is not None)
    try:
        with watched as (say, advance), closing(results):
            for job, outcome in results:
                if failed == options.max_failures:  # and there is another one
                    end = End.STOPPED
                    break
                row = classify(replace(outcome.row, name=job.name, use="", error=outcome.error))
                text = line(job.path, row) if line else outcome.summary
                whole = len(jobs) == 1 or options.verbose
                _say(options, job, outcome, text if whole else text.partition("\n")[0], say)
                for warning in outcome.warnings:  # one about each option: of most photographs it is the same
                    if (about := warning.partition(" ")[0]) not in warned and not options.quiet:
                        complain(Blur2ViewError(f"{job.path}: {warning}"), say)
                    warned.add(about)
                if not options.inputs.is_folder(job.path):
                    rows.append(row)
                done.append((job.path, outcome if options.keeps else replace(outcome, payload=None)))
                failed += bool(outcome.error)
                advance()
                if outcome.stop:
                    end = End.STOPPED
                    break
    except KeyboardInterrupt:
        end = End.INTERRUPTED
    except (RunError, OutputError) as error:  # no cluster, or no manifest, any more; it says how to go on
        complain(error)
        end = End.BROKEN
    has_table, seconds = _write_table(options.csv, rows), time.monotonic() - start
    run = Finished(outcomes=done, rows=rows, end=end, has_table=has_table, seconds=seconds)
    _print_end(run, len(jobs), manifest, total=options.prints and line is None)
    return run


def _say(options: PhotographOptions, job: Job, outcome: Outcome, text: str, say: Say) -> None:
    """Print what became of a photograph: why it failed, or the text; with --jsonl its document."""
    if outcome.error:
        complain(Blur2ViewError(outcome.error), say)
    elif options.prints and (not outcome.skipped or options.verbose):
        say("\n".join(map(printable, text.split("\n"))))  # a manifest's may hold anything
    if options.jsonl:
        failure = {"image": str(job.path), "error": outcome.error}
        print(json.dumps(failure if outcome.error else outcome.payload, allow_nan=False), flush=True)


def _write_table(target: Path | None, rows: Sequence[Row]) -> bool:
    """Return whether the table could be written, if one is wanted; the others are of use without it."""
    try:
        if target is not None and rows:
            write_text(target, table_text(rows))
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


def jobs_of(options: PhotographOptions, plan: Sequence[ResultFiles | OutputError] = ()) -> list[Job]:
    """Return the jobs of a command, with the files of each, if it has some, or why they cannot be written."""
    paths, table = options.inputs.paths, options.timestamps
    neighbours, names = neighbours_of(paths, options.sequence), colmap_names(options.inputs)
    times = [None] * len(paths) if table is None else timestamps_of(paths, table)
    jobs = []
    for index, (path, time_s) in enumerate(zip(paths, times, strict=True)):
        files = plan[index] if plan else None
        refusal, files = (files, None) if isinstance(files, OutputError) else (None, files)
        source = "" if table is None else f"{time_s}"
        job = Job(index=index, path=path, name=names[path], files=files, refusal=refusal)
        jobs.append(replace(job, neighbours=neighbours[path], timestamp_s=time_s, source=source))
    return jobs


def refuse_shared(options: PhotographOptions, target: Path, others: Paths, option: str) -> None:
    """Refuse a table or a list that would be one file with another one of the call."""
    real = os.path.realpath(target)
    if real in {os.path.realpath(other) for other in others if other is not None}:
        raise OutputError(f"{target}: two results would be one file; name another with {option}")
    if real in {os.path.realpath(path) for path in options.inputs.lists}:
        raise OutputError(f"{target}: names the photographs of this call; name another with {option}")


def manifest_of(options: PhotographOptions, target: Path | None) -> Path | None:
    """Return the hidden manifest of a file of all photographs; one alone leaves nothing to go on with."""
    if target is None or (len(options.inputs.paths) == 1 and not options.resume):
        return None
    target = Path(os.path.abspath(target))  # . has no name
    return target.with_name(f".{target.name}{ENDING}")
