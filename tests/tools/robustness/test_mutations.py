"""Mutants are what they say, and tests that notice them are told from those that do not."""

from pathlib import Path
from queue import Queue

import pytest

from tools.robustness.mutation_sites import Mutant, mutants_of
from tools.robustness.mutations import KILLED, SURVIVED, UNREACHED, Reached, core_mutants, judge, report

SOURCE = '''"""A module."""

LIMIT = 3


class Box:
    """A box."""

    size: int = 4

    def fits(self, length: float) -> bool:
        """Return whether."""
        return length + 1 < self.size and not length < 0


def both(a: list, b: list) -> int:
    """Return."""
    if len(a) > 2:
        raise ValueError("too many")
    a.sort()
    return min(a @ b, 0.5)
'''


def test_every_kind_of_change_is_made_where_it_can_be() -> None:
    mutants = list(mutants_of("m.py", SOURCE))
    changes = {(mutant.function, mutant.change) for mutant in mutants}
    assert changes >= {
        ("LIMIT", "`3` to `4`"),
        ("size", "`4` to `5`"),
        ("Box.fits()", "`length + 1` to `((length) - (1))`"),
        ("Box.fits()", "`length + 1 < self.size` to `(length + 1 >= self.size)`"),
        ("Box.fits()", "`not length < 0` to `(length < 0)`"),
        ("Box.fits()", "`length < 0` to `(length <= 0)`"),
        ("both()", "`a @ b` to `((b) @ (a))`"),
        ("both()", "`min` to `max`"),
        ("both()", "`0.5` to `1.0`"),
        ("both()", "`a.sort()` to `pass`"),
        ("both()", '`raise ValueError("too many")` to `pass`'),
    }
    assert len({mutant.source for mutant in mutants}) == len(mutants)
    assert all(mutant.source != SOURCE for mutant in mutants)


def test_mutants_of_the_core_are_python() -> None:
    mutants = list(core_mutants())
    assert len(mutants) > 5000
    for mutant in mutants[::97]:
        compile(mutant.source, mutant.path, "exec")


def some_mutant(change: str) -> Mutant:
    return next(mutant for mutant in mutants_of("m.py", SOURCE) if mutant.change == change)


@pytest.mark.slow
def test_mutants_that_a_test_notices_are_killed(tmp_path: Path) -> None:
    (tmp_path / "m.py").write_text(SOURCE)
    (tmp_path / "test_m.py").write_text(
        "import m\n\ndef test_it() -> None:\n    assert m.Box().fits(2.5) and not m.Box().fits(3)\n"
    )
    reached = Reached(
        functions={"test_m.py::test_it": ["m.py:Box.fits()"]}, seconds={"test_m.py::test_it": 0.1}
    )
    copies: Queue[Path] = Queue()
    copies.put(tmp_path)
    changes = "`length + 1` to `((length) - (1))`", "`length < 0` to `(length <= 0)`", "`min` to `max`"
    outcomes = {change: judge(some_mutant(change), reached, copies) for change in changes}
    assert list(outcomes.values()) == [KILLED, SURVIVED, UNREACHED]
    assert (tmp_path / "m.py").read_text() == SOURCE
    mutants = [some_mutant(change) for change in outcomes]
    table = report(mutants, list(outcomes.values()), 9, 0)
    assert (
        "| killed | 1 |" in table
        and "`m.py:13` Box.fits() | `length < 0` to `(length <= 0)` | survived |" in table
    )
