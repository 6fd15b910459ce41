"""What a command prints of its photographs: a line for each, then a document, a table or a total."""

import json
from collections.abc import Mapping
from pathlib import Path

from blur2view.cli.batch.job import Outcome
from blur2view.cli.batch.run import Run
from blur2view.cli.options import STANDARD_OUTPUT
from blur2view.cli.terminal import complain, plural, printable, say
from blur2view.errors import Blur2ViewError
from blur2view.records.record import table_text


def print_failure(run: Run, outcome: Outcome) -> None:
    """Print why a photograph failed; nothing of any other, nor of a frame that fails as one before did."""
    alike = outcome.error and run.frames_by_reason[run.reason_of_last()] > 1
    if outcome.error and (run.options.printing.verbose or not alike):
        complain(Blur2ViewError(outcome.error))


def print_summary(run: Run, outcome: Outcome) -> None:
    """Print why a photograph failed, or its summary: whole if it is the only one, else the first line."""
    print_failure(run, outcome)
    in_full = len(run.jobs) == 1 or run.options.printing.verbose
    if not outcome.error and not run.options.silent and (in_full or not outcome.skipped):
        summary = outcome.summary.split("\n")
        say("\n".join(map(printable, summary if in_full else summary[:1])))


def print_document(run: Run, name: str) -> None:
    """Print the document of --json, which has the records by a name, and failures; nothing without --json."""
    if run.options.document.json:
        records = [outcome.record.to_dict() for outcome in run.done]
        print(json.dumps({name: records, "failures": run.failures}, indent=2, allow_nan=False))


def print_table(run: Run) -> None:
    """Print the table of ``--csv -``; nothing if it is a file, or there is none."""
    if run.options.table.csv == STANDARD_OUTPUT and run.records:
        table = table_text(run.records, run.options.columns)
        print(table.decode("utf-8", "surrogateescape"), end="")


def print_total(run: Run) -> None:
    """Print how many of several photographs were done, or of one the table, unless the run ended early."""
    if run.early_exit_code or run.options.silent:
        return
    skipped, failed = sum(outcome.skipped for outcome in run.done), len(run.failures)
    counts = {"done": len(run.done) - skipped, "done before": skipped, "failed": failed}
    if len(run.outcomes) > 1:
        print_counts(run, counts, *([run.options.folder.output, run.table] if counts["done"] else []))
    else:
        print_written_table(run)


def print_written_table(run: Run) -> None:
    """Print where the table is, if it was written."""
    if run.table is not None and not run.early_exit_code and not run.options.silent:
        print(f"wrote {printable(str(run.table))}")


def print_counts(run: Run, counts: Mapping[str, int], *files: Path | None, said: str = "") -> None:
    """Print counts of photographs by their words in one line, then ``said``, then the files written."""
    parts = ", ".join(f"{count} {words}" for words, count in counts.items() if count)
    line = f"{plural(len(run.outcomes), run.noun)}: {parts} ({run.seconds:.1f} s)"
    paths = " and ".join(printable(str(path)) for path in files if path is not None)
    wrote_paths = f"wrote {paths}" if paths else ""
    print("; ".join(part for part in (line, said, wrote_paths) if part))
