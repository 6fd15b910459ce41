"""Statements on a database of SQLite, as a user may run them by hand."""

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any


def run_sql(path: Path, *statements: str) -> list[tuple[Any, ...]]:
    """Run statements, each committed, with foreign keys; return the rows of the last."""
    rows: list[tuple[Any, ...]] = []
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.execute("PRAGMA foreign_keys = ON")
        for statement in statements:
            rows = database.execute(statement).fetchall()
    return rows
