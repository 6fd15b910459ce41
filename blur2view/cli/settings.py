"""What the results of a call depend on, as a manifest names it."""

import argparse
from pathlib import Path
from typing import Any

from blur2view import __version__
from blur2view.batch.job import file_digest
from blur2view.batch.manifest import Settings
from blur2view.networks.model_file import model_path

INPUT = {"images", "inputs", "recursive", "every", "first", "last"}
RUNNING = {"command", "run", "jobs", "dask", "resume", "max_failures", "max_memory"}
OUTPUT = {"output", "overwrite", "json", "verbosity", "db", "dry_run", "no_backup", "replace", "format"}
OF_ALL = {"skip_degenerate", "corrected", "sequence", "csv", "keep", "blurred", "max_smear"}
OF_THE_CALL = INPUT | RUNNING | OUTPUT | OF_ALL | {"model"}
"""Options on which no photograph's own result depends, and --model, which stands for its file."""


def settings_of(options: argparse.Namespace) -> Settings:
    """Return the options and the files on which the result of every photograph depends."""
    depends = {name: value for name, value in vars(options).items() if name not in OF_THE_CALL}
    files = {"model": model_path(options.model)}
    database = Path((options.camera or "").rpartition(":")[0] or options.camera or "")
    for path in (Path(options.camera or ""), database):
        if path.is_file():
            files["camera"] = path
    return Settings(
        command=options.command,
        version=__version__,
        options={name: _plain(value) for name, value in sorted(depends.items())},
        files={name: file_digest(path) for name, path in files.items()},
    )


def _plain(value: Any) -> Any:
    """Return an option in JSON's types."""
    return str(value) if isinstance(value, Path) else value
