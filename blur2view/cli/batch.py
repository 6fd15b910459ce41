"""A command over many photographs: planned before any work, done, printed and written down."""

import argparse
import os
import sys
import time
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Generic, TypeVar

from blur2view.batch.inputs import Inputs
from blur2view.batch.job import Job, Kept, Target, Work
from blur2view.batch.manifest import Manifest
from blur2view.batch.processes import Engine, processes
from blur2view.batch.run import Batch, Result
from blur2view.cli.settings import settings_of
from blur2view.cli.terminal import PHOTOGRAPH, QUIET, SHORT, Progress, complain, plural
from blur2view.documents.document import Document, FailureDocument
from blur2view.documents.table import Row, row, table_text
from blur2view.errors import Blur2ViewError, OutputError, RunError
from blur2view.networks.model_file import usable_cores
from blur2view.output_files import (
    GO_ON,
    Files,
    ResultFiles,
    ResultKind,
    below_shared_folder,
    check_file,
    is_there,
    plan_outputs,
    prepare_folder,
    remove_empty,
    remove_left_over,
    unwritable,
    write_atomically,
)

DONE, FAILED, INTERRUPTED = 0, 1, 130
Made = TypeVar("Made", bound=Document)


class CommandRun(Generic[Target, Kept]):
    """The run of a command over its photographs, with what is printed meanwhile.

    Parameters
    ----------
    options : argparse.Namespace
    work : Work
    manifest : Path or None
        The file in which is written down what is done; None if nothing is written.
    files : collection of Path
        Those of single photographs that will be written.
    prints : bool
        Whether a line is printed for each photograph, and a total.

    Attributes
    ----------
    interrupted, broken : bool
        Whether it ended early: by Ctrl-C, or as no photograph could be done any more; of the latter, files of
        all photographs stay as an earlier call left them, but for the table.
    rows : list of Row
        Of the table, as far as the run has come; written at its end, however it ends, if --csv asks for it.
    has_table : bool
        Whether it was not asked for, or could be written.
    judge : callable
        Adds to a row what the command says of it.
    """

    def __init__(
        self,
        options: argparse.Namespace,
        work: Work[Target, Kept],
        manifest: Path | None,
        *,
        files: Collection[Path] = (),
        prints: bool = True,
    ) -> None:
        self.options, self.work = options, work
        self.count = len(options.images)
        self.done = self.skipped = self.failed = 0
        self.interrupted = self.broken = False
        self.has_table = True
        self.warned: set[str] = set()
        self.prints = prints and not options.json and options.verbosity > QUIET
        self.rows: list[Row] = []
        self.judge: Callable[[Row], Row] = lambda row: row
        self.names = colmap_names(options.inputs)
        overwrite = getattr(options, "overwrite", False) or options.resume
        if options.csv is not None:
            check_file(
                options.csv,
                "table",
                options.images,
                overwrite=overwrite,
                option="--csv",
                remedy=GO_ON if hasattr(options, "overwrite") else "--resume to go on",
            )
        named = {name: getattr(options, name, None) for name in ("csv", "keep", "output", "db")}
        for name in ("csv", "keep"):
            if (target := named.pop(name)) is not None:
                others = (*named.values(), manifest, *files)
                _refuse_shared(target, others, options.inputs.lists, f"--{name}")
        self.manifest: Manifest | None = None
        # one photograph alone leaves nothing to go on with
        if manifest is not None and (self.count > 1 or options.resume):
            self.manifest = Manifest(manifest, settings_of(options), resume=options.resume)
            if self.manifest.cut_off:
                complain(OutputError(f"{manifest}: its last line was cut off; that photograph is done again"))

    def replaces(self, target: Path) -> bool:
        """Return whether a file of all photographs is as an earlier call left it, and this one goes on."""
        return self.options.resume and self.manifest is not None and self.manifest.wrote(target)

    @property
    def exit_code(self) -> int:
        """Return the exit code: 0 done, 1 something failed, 130 interrupted."""
        failed = self.failed or self.broken or not self.has_table
        return INTERRUPTED if self.interrupted else FAILED if failed else DONE

    def results(
        self,
        paths: Sequence[Path],
        targets: Sequence[Target | Blur2ViewError],
        sources: Sequence[str] | None = None,
    ) -> Generator[Result[Kept]]:
        """Yield the result of every photograph, in order, after printing its line.

        Ends early, after a line that says how to go on, if it is interrupted, no photograph can be done any
        more, as on a full disk, or as many failed as --max-failures allows.

        Parameters
        ----------
        paths : sequence of Path
            The photographs.
        targets : sequence
            What the work on each photograph needs besides; an error if it cannot be begun.
        sources : sequence of str, optional
            What each result depends on besides.
        """
        start = time.monotonic()
        self.count = len(paths)
        created = [] if self.options.csv is None else prepare_folder(self.options.csv.parent)
        batch = Batch(
            work=self.work,
            engine=self._engine(),
            sends=self.options.dask is not None,
            manifest=self.manifest,
            folder=Path() if self.manifest is None else self.manifest.path.parent,
        )
        bar = Progress(self.count, PHOTOGRAPH)
        most = self.options.max_failures
        stopped = ""
        try:
            with closing(batch.results(self._jobs(paths, targets, sources))) as results:
                for result in results:
                    said = None if result.made is None else result.made.row
                    judged = self.judge(row(self.names[result.path], said, result.error))
                    self._tell(result, bar, judged.use)
                    if not self.options.inputs.is_folder(result.path):
                        self.rows.append(judged)
                    yield result
                    if result.stop or (most is not None and self.failed >= most):
                        stopped = "stopped"
                        break
        except KeyboardInterrupt:
            self.interrupted = True
            stopped = "interrupted"
        except (RunError, OutputError) as error:  # no cluster, or no manifest, any more; it says how to go on
            complain(error)
            self.broken = True
        finally:
            bar.close()
            self._write_table()
            remove_empty(created)
        if stopped and (self.interrupted or self.count > 1):
            print(f"blur2view: {stopped}{self._how_to_go_on()}", file=sys.stderr)
        elif self.count > 1 and self.prints and not self.broken:
            print(self._total(time.monotonic() - start))

    def _write_table(self) -> None:
        """Write the table, if one is wanted; where it cannot be, the other results are still of use."""
        if self.options.csv is None or not self.rows:
            return
        try:
            write_text(self.options.csv, table_text(self.rows))
        except OutputError as error:
            complain(error)
            self.has_table = False

    def _engine(self) -> Engine:
        """Return where the work is done."""
        if self.options.dask is not None:
            from blur2view.batch.cluster import Cluster

            return Cluster(self.options.dask)
        return processes(max(min(self.options.jobs or usable_cores(), self.count), 1))

    def _jobs(
        self,
        paths: Sequence[Path],
        targets: Sequence[Target | Blur2ViewError],
        sources: Sequence[str] | None,
    ) -> Iterator[Job[Target] | Result[Kept]]:
        """Yield the job of every photograph, or why it has none."""
        refused = self.options.inputs.refused
        for index, (path, target) in enumerate(zip(paths, targets, strict=True)):
            if path in refused:
                yield Result(index=index, path=path, error=refused[path])
            elif isinstance(target, Blur2ViewError):
                yield Result(index=index, path=path, error=str(target))
            elif other := self._other_owner(path, target):
                told = f"its results would replace those of {other}; use another -o or add --overwrite"
                yield Result(index=index, path=path, error=f"{path}: {told}")
            else:
                yield Job(index=index, path=path, target=target, source=sources[index] if sources else "")

    def _other_owner(self, path: Path, target: object) -> str | None:
        """Return the photograph whose results another one's would replace in a run that goes on."""
        if self.manifest is None or not self.options.resume or getattr(self.options, "overwrite", False):
            return None
        return self.manifest.other_owner(path, target.paths) if isinstance(target, ResultFiles) else None

    def _tell(self, result: Result[Kept], bar: Progress, use: str) -> None:
        """Count a photograph and print its line: of many the first of its summary, unless all is wanted."""
        self.skipped += result.skipped
        self.done += result.made is not None and not result.skipped
        self.failed += result.made is None
        bar.step()
        if result.made is None:
            complain(Blur2ViewError(result.error), bar.say)
            return
        self._warn(result.path, result.made.warnings, bar)
        if self.prints:
            short = self.count > 1 and self.options.verbosity == SHORT
            summary = result.made.summary.partition("\n")[0] if short else result.made.summary
            bar.say(f"{summary}; {use}" if use else summary)

    def _warn(self, path: Path, warnings: Iterable[str], bar: Progress) -> None:
        """Print warnings, of each option one: of most photographs it is the same."""
        for warning in warnings:
            if (option := warning.partition(" ")[0]) not in self.warned and self.options.verbosity > QUIET:
                complain(Blur2ViewError(f"{path}: {warning}"), bar.say)
                self.warned.add(option)

    def _how_to_go_on(self) -> str:
        """Return what is said of a run that ended early."""
        if self.count == 1:
            return ""
        told = f" after {self.done + self.skipped + self.failed} of {plural(self.count, 'photograph')}"
        return told + ("; what is done is kept, the same call with --resume goes on" if self.manifest else "")

    def _total(self, seconds: float) -> str:
        """Return the closing line."""
        parts = [f"{self.done} done"] if self.done or not (self.skipped or self.failed) else []
        parts += [f"{self.skipped} done before"] * bool(self.skipped)
        parts += [f"{self.failed} failed"] * bool(self.failed)
        rate = f", {self.done / seconds:.2g} a second" if self.done and seconds > 0 else ""
        return f"{plural(self.count, 'photograph')}: {', '.join(parts)} in {seconds:.1f} s{rate}"


def colmap_names(inputs: Inputs) -> dict[Path, str]:
    """Return the name of every photograph below the one folder that was given, or else that all share."""
    below = {path: name.parent / path.name for path, name in inputs.names.items() if name.parent != Path()}
    shared = below_shared_folder(inputs.paths)
    names = {path: name.as_posix() for path, name in zip(inputs.paths, shared, strict=True)}
    there = [path for path in inputs.paths if is_there(path)] or inputs.paths
    roots = {path.parents[len(name.parts) - 1] for path, name in below.items()}
    roots |= {path.parent for path in there if path not in below}
    if len(roots) == 1:
        (root,) = roots
        return {
            path: path.relative_to(root).as_posix() if path.is_relative_to(root) else name
            for path, name in names.items()
        }
    return names


def _refuse_shared(target: Path, others: Iterable[Path | None], lists: Iterable[Path], option: str) -> None:
    """Refuse a table or a list that would be one file with another one of the call."""
    real = os.path.realpath(target)
    if real in {os.path.realpath(other) for other in others if other is not None}:
        raise OutputError(f"{target}: two results would be one file; name another with {option}")
    if real in {os.path.realpath(path) for path in lists}:
        raise OutputError(f"{target}: names the photographs of this call; name another with {option}")


def write_text(target: Path, text: str) -> None:
    """Write a table or a list, whole or not at all."""
    created = prepare_folder(target.parent)
    try:
        write_atomically(target, lambda file: file.write(text.encode("utf-8", "surrogateescape")))
    except OSError as error:
        remove_empty(created)
        raise unwritable(target.parent, error) from None


def manifest_beside(target: Path) -> Path:
    """Return the manifest of a file of all photographs."""
    named = target if target.name else Path(os.path.abspath(target))  # . has no name
    return named.with_name(f"{named.name}.manifest.jsonl")


def plan_files(options: argparse.Namespace, kind: ResultKind[Files]) -> Sequence[Files | OutputError | None]:
    """Return where each photograph's results go, decided before any work; None without -o."""
    if options.output is None:
        return [None] * len(options.images)
    may = {"overwrite": options.overwrite, "resume": options.resume}
    return plan_outputs(options.images, options.output, **may, kind=kind, names=options.inputs.names)


def run_each(
    options: argparse.Namespace,
    plan: Sequence[Files | OutputError | None],
    work: Work[Files | None, Made],
    collect: Callable[[list[Made], list[FailureDocument]], Document],
) -> int:
    """Return the exit code, after the work on every photograph; one that fails costs a line on stderr.

    With ``--json`` the one document of ``collect`` is printed at the end.
    """
    paths = {path for files in plan if files and not isinstance(files, OutputError) for path in files.paths}
    folders = {path.parent for path in paths}
    manifest = None if options.csv is None else manifest_beside(options.csv)
    if options.output is not None:
        manifest = options.output / f"{options.command}.manifest.jsonl"
    run: CommandRun[Files | None, Made] = CommandRun(options, work, manifest, files=paths)
    created: list[Path] = []
    documents: list[Made] = []
    failures: list[FailureDocument] = []
    try:
        for folder in sorted(folders):
            created += prepare_folder(folder)
        for result in run.results(options.images, plan):
            if result.made is None:
                failures.append(FailureDocument(image=str(result.path), error=result.error))
            elif options.json:
                documents.append(result.made.kept)
    finally:
        if options.resume:  # at the end: workers of a killed call live on for a moment
            remove_left_over(paths, folders)
        remove_empty(sorted(created, reverse=True))  # where nothing succeeded nothing is left behind
    if options.json:
        print(collect(documents, failures).to_json())
    return run.exit_code
