"""Jobs in this process and in several: order, failures, processes that die."""

import os
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from blur2view.errors import ImageError
from blur2view.runs.job import Job, Outcome, neighbours_of
from blur2view.runs.processes import Engine, in_processes, processes
from blur2view.runs.run import outcomes


class CountWork:
    """Counts the bytes of a file; the first take longest, and a word in the file makes it fail or die."""

    def __call__(self, job: Job) -> Outcome:
        """Return the process and the number of bytes."""
        content = job.encoded
        time.sleep(job.target)
        if content == b"fail":
            raise ImageError(f"{job.path}: fails")
        if content == b"die":
            os._exit(9)
        return Outcome(payload=(os.getpid(), len(content)), summary=str(job.path))


def results(engine: Engine, folder: Path, words: list[str], pause_s: float = 0.0) -> list[Outcome]:
    """Return the outcomes of files that hold these words, which come in the order of the files."""
    for index, word in enumerate(words):
        (folder / f"{index}.txt").write_text(word)
    jobs = [
        Job(index=index, path=folder / f"{index}.txt", target=pause_s * (len(words) - index))
        for index in range(len(words))
    ]
    found = list(outcomes(CountWork(), jobs, engine))
    assert [job.index for job, _ in found] == list(range(len(words)))
    return [outcome for _, outcome in found]


def lengths(found: list[Outcome]) -> list[int | None]:
    """Return the numbers of bytes, None of what failed."""
    return [None if one.error else one.payload[1] for one in found]


@pytest.mark.slow
def test_results_of_several_processes_come_in_order(tmp_path: Path) -> None:
    found = results(processes(2), tmp_path, ["a", "bb", "fail", "dddd", "eeeee"], pause_s=0.05)
    assert lengths(found) == [1, 2, None, 4, 5]
    others = {one.payload[0] for one in found if not one.error}
    assert len(others) == 2 and os.getpid() not in others


@pytest.mark.slow
def test_process_that_dies_costs_the_photograph_that_killed_it(tmp_path: Path) -> None:
    found = results(processes(2), tmp_path, ["a", "bb", "die", "dddd", "eeeee", "ffffff"])
    assert lengths(found) == [1, 2, None, 4, 5, 6]
    assert "2.txt: the process that read it died" in found[2].error


@pytest.mark.slow
def test_no_process_is_left_when_a_run_is_abandoned(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("a")
    jobs = [Job(index=n, path=tmp_path / "a.txt", target=0.01) for n in range(50)]
    running = in_processes(CountWork(), iter(jobs), count=2)
    _, outcome = next(running)
    running.close()
    with pytest.raises(ProcessLookupError):
        os.kill(outcome.payload[0], 0)


def _beside(paths: Sequence[Path], sequence: bool | None) -> list[list[tuple[int, Path]]]:
    """Return the steps to the neighbours of each photograph, and where they are."""
    return [[(one.steps, one.path) for one in found] for found in neighbours_of(paths, sequence).values()]


def test_neighbours_are_named_beside_a_photograph_and_lie_in_its_folder() -> None:
    first, second, elsewhere = paths = [Path("a/1.png"), Path("a/2.png"), Path("b/1.png")]
    assert _beside(paths, True) == [[(1, second)], [(-1, first)], []]
    assert _beside([elsewhere, first, second], True) == [[], [(1, second)], [(-1, first)]]
    assert _beside(paths, None) == [[], [], []]
