"""Files beside each photograph: planned before any work, written one photograph after another."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from blur2view.cli.terminal import QUIET, complain, progress
from blur2view.documents.document import Document, FailureDocument
from blur2view.errors import Blur2ViewError, OutputError, within_memory
from blur2view.output_files import Files, ResultKind, plan_outputs, prepare_folder, remove_empty

DONE, FAILED = 0, 1
Made = TypeVar("Made", bound=Document)
Work = Callable[[Path, Files | None], tuple[Made, str]]
"""From a photograph and its files, if any, to its JSON document and its summary."""


def plan_files(options: argparse.Namespace, kind: ResultKind[Files]) -> Sequence[Files | OutputError | None]:
    """Return where each photograph's results go, decided before any work; None without -o."""
    if options.output is None:
        return [None] * len(options.images)
    return plan_outputs(options.images, options.output, overwrite=options.overwrite, kind=kind)


def run_each(
    options: argparse.Namespace,
    plan: Sequence[Files | OutputError | None],
    work: Work[Files, Made],
    collect: Callable[[list[Made], list[FailureDocument]], Document],
) -> int:
    """Return the exit code, after the work on every photograph; one that fails costs a line on stderr.

    With ``--json`` the one document of ``collect`` is printed at the end.
    """
    folders = {
        path.parent for files in plan if files and not isinstance(files, OutputError) for path in files.paths
    }
    created = [made for folder in sorted(folders) for made in prepare_folder(folder)]
    jobs, say = progress(list(zip(options.images, plan, strict=True)))
    documents: list[Made] = []
    failures: list[FailureDocument] = []
    for image, files in jobs:
        try:
            if isinstance(files, OutputError):
                raise files
            with within_memory(image):
                document, summary = work(image, files)
        except Blur2ViewError as error:
            failures.append(FailureDocument(image=str(image), error=str(error)))
            complain(error, say)
            continue
        documents.append(document)
        if not options.json and options.verbosity > QUIET:
            say(summary)
    remove_empty(sorted(created, reverse=True))  # where nothing succeeded nothing is left behind
    if options.json:
        print(collect(documents, failures).to_json())
    return FAILED if failures else DONE
