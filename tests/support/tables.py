"""The table of ``--csv``, as it is read by others."""

import csv
from pathlib import Path

READ = {"name", "use", "blur", "config", "verdict", "error"}  # columns that scripts read


def table(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table."""
    with path.open(newline="") as file:
        reader = csv.DictReader(file)
        rows = list(reader)
    assert set(reader.fieldnames or ()) >= READ
    return rows
