"""Finished instances of the estimators' comparison, one JSON line each: a run that was killed goes on."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from tools.benchmarks.estimator_cells import Instance
from tools.evaluation.evaluate import Judged


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

    def to_json(self) -> str:
        """Return one line, figures to five digits."""
        rows = {
            method: {name: float(f"{value:.5g}") for name, value in vars(figures).items()}
            for method, figures in self.measured.items()
        }
        return json.dumps({**vars(self.instance), "measured": rows})

    @classmethod
    def from_json(cls, line: str) -> Record:
        """Return the record of a line of `to_json`."""
        stored = json.loads(line)
        rows = stored.pop("measured")
        measured = {method: Measured(**row) for method, row in rows.items()}
        return cls(instance=Instance(**stored), measured=measured)


@dataclass(frozen=True, kw_only=True)
class Log:
    """The file: a first line that says from which code and machine the figures are, then the records."""

    path: Path

    def read(self) -> list[Record]:
        """Return what is finished; a last line cut short by a kill is left out."""
        return [Record.from_json(line) for line in self._lines()[1:]]

    def head(self) -> dict[str, str]:
        """Return the first line; empty where there is none."""
        lines = self._lines()
        found: dict[str, str] = json.loads(lines[0]) if lines else {}
        return found

    def _lines(self) -> list[str]:
        if not self.path.exists():
            return []
        return [line for line in self.path.read_text().splitlines(keepends=True) if line.endswith("\n")]

    def begin(self, head: dict[str, str]) -> None:
        """Start a new file, or mend one that a kill cut short.

        ValueError if the file holds figures of other code: those of two versions must not be mixed.
        """
        before = self.head()
        if before and before["code"] != head["code"]:
            raise ValueError(f"{self.path} holds figures of other code: remove it or give another --log")
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.write_text("".join(self._lines()) if before else json.dumps(head) + "\n")

    def append(self, record: Record) -> None:
        """Append one line."""
        with self.path.open("a") as stream:
            stream.write(record.to_json() + "\n")
