"""Files beside each photograph: planned before any work, written one photograph after another."""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from blur2view.cli.options import complain, progress
from blur2view.errors import Blur2ViewError, OutputError
from blur2view.output_files import Files, ResultKind, plan_outputs, prepare_folder

DONE, FAILED = 0, 1
Work = Callable[[Path, Files | None], tuple[dict[str, Any], str]]
"""From a photograph and its files, if any, to its JSON document and its summary."""


def plan_files(options: argparse.Namespace, kind: ResultKind[Files]) -> Sequence[Files | OutputError | None]:
    """Decide before any work where each photograph's results go; nowhere without -o."""
    if options.output is None:
        return [None] * len(options.images)
    prepare_folder(options.output)
    return plan_outputs(options.images, options.output, overwrite=options.overwrite, kind=kind)


def run_each(
    options: argparse.Namespace, plan: Sequence[Files | OutputError | None], key: str, work: Work[Files]
) -> int:
    """Do the work on every photograph; a failing one costs a line on stderr, not the others.

    With ``--json`` one document is printed at the end, ``{key: [...], "failures": [...]}``. Returns the exit
    code.
    """
    jobs, say = progress(list(zip(options.images, plan, strict=True)))
    documents: list[dict[str, Any]] = []
    failures: list[dict[str, str]] = []
    for image, files in jobs:
        try:
            if isinstance(files, OutputError):
                raise files
            facts, lines = work(image, files)
        except Blur2ViewError as error:
            failures.append({"image": str(image), "error": str(error)})
            complain(error, say)
            continue
        documents.append(facts)
        if not options.json:
            say(lines, file=sys.stdout)
    if options.json:
        print(json.dumps({key: documents, "failures": failures}, indent=2, allow_nan=False))
    return FAILED if failures else DONE
