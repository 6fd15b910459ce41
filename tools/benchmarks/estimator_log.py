"""Finished instances of the estimators' comparison, one JSON line each: a run that was killed goes on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tools.benchmarks.estimator_cells import Instance
from tools.evaluation.evaluate import Judged
from tools.pages import append_line, finished_lines


@dataclass(frozen=True, kw_only=True)
class Measured(Judged):
    """One method on one instance: `tools.evaluation.evaluate.Judged`, and the rest.

    ``pose_deg`` is `pose_error.pose_error_deg`, ``ms`` the CPU time of the call, ``found`` 1 if there
    was an F.
    """

    pose_deg: float
    ms: float
    found: float


@dataclass(frozen=True, kw_only=True)
class Record:
    """All methods on one instance."""

    instance: Instance
    measured: dict[str, Measured]

    def document(self) -> dict[str, Any]:
        """Return what is stored: figures to five digits."""
        rows = {
            method: {name: float(f"{value:.5g}") for name, value in vars(figures).items()}
            for method, figures in self.measured.items()
        }
        return {**vars(self.instance), "measured": rows}

    @classmethod
    def of(cls, stored: dict[str, Any]) -> Record:
        """Return the record of a `document`."""
        measured = {method: Measured(**row) for method, row in stored.pop("measured").items()}
        return cls(instance=Instance(**stored), measured=measured)


def begun(path: Path, head: dict[str, str]) -> list[Record]:
    """Return the finished records of a log, whose first line says from which code they are, or begin one.

    SystemExit if they are of other code: figures of two versions must not be mixed.
    """
    before, records = read(path)
    if not before:
        path.parent.mkdir(parents=True, exist_ok=True)
        append_line(path, head)
    elif before["code"] != head["code"]:
        raise SystemExit(f"{path} holds figures of other code: remove it or give another --log")
    return records


def read(path: Path) -> tuple[dict[str, str], list[Record]]:
    """Return the first line of a log, empty where there is none, and the records."""
    head, *rows = finished_lines(path) or [{}]
    return head, [Record.of(row) for row in rows]
