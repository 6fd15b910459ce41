"""Jobs in this process and in several: order, failures, processes that die."""

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from blur2view.errors import ImageError
from blur2view.results.table import Row
from blur2view.runs.job import Job, Outcome, Result, Work
from blur2view.runs.processes import Engine, in_processes, in_this_process, processes
from blur2view.runs.run import outcomes
from tests.support.many_photographs import announcing, write_video


@dataclass(frozen=True, kw_only=True)
class Number:
    """What is kept of a photograph."""

    process: int
    length: int


@dataclass(frozen=True, kw_only=True)
class CountWork(Work[float, Number]):
    """Counts the bytes of a file; the first take longest, and a word in the file makes it fail or die."""

    def __call__(self, job: Job[float]) -> Result[Number]:
        """Return the number of bytes."""
        content = job.encoded
        time.sleep(job.target)
        if content == b"fail":
            raise ImageError(f"{job.path}: fails")
        if content == b"die":
            os._exit(9)
        return Result(
            payload=Number(process=os.getpid(), length=len(content)), summary=str(job.path), row=Row()
        )


def results(engine: Engine, folder: Path, words: list[str], pause_s: float = 0.0) -> list[Outcome[Number]]:
    """Return the outcomes of files that hold these words, which come in the order of the files."""
    for index, word in enumerate(words):
        (folder / f"{index}.txt").write_text(word)
    pauses = [pause_s * (len(words) - index) for index in range(len(words))]
    jobs = [
        Job(index=index, path=folder / f"{index}.txt", target=pause) for index, pause in enumerate(pauses)
    ]
    found = list(outcomes(CountWork(), jobs, engine))
    assert [job.index for job, _ in found] == list(range(len(words)))
    return [outcome for _, outcome in found]


def test_one_process_is_this_one(tmp_path: Path) -> None:
    assert processes(1) is in_this_process
    found = results(processes(1), tmp_path, ["a", "fail", "ccc"])
    assert [(one.result and one.result.payload.length, one.error) for one in found] == [
        (1, ""), (None, f"{tmp_path / '1.txt'}: fails"), (3, "")
    ]  # fmt: skip
    assert found[0].result is not None and found[0].result.payload.process == os.getpid()


@pytest.mark.slow
def test_results_of_several_processes_come_in_order(tmp_path: Path) -> None:
    found = results(processes(2), tmp_path, ["a", "bb", "fail", "dddd", "eeeee"], pause_s=0.05)
    assert [one.result and one.result.payload.length for one in found] == [1, 2, None, 4, 5]
    others = {one.result.payload.process for one in found if one.result is not None}
    assert len(others) == 2 and os.getpid() not in others


@pytest.mark.slow
def test_process_that_dies_costs_the_photograph_that_killed_it(tmp_path: Path) -> None:
    found = results(processes(2), tmp_path, ["a", "bb", "die", "dddd", "eeeee", "ffffff"])
    assert [one.result and one.result.payload.length for one in found] == [1, 2, None, 4, 5, 6]
    assert "2.txt: the process that read it died" in found[2].error


@pytest.mark.slow
def test_no_process_is_left_when_a_run_is_abandoned(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("a")
    jobs: list[Job[float]] = [Job(index=n, path=tmp_path / "a.txt", target=0.01) for n in range(50)]
    running = in_processes(CountWork(), iter(jobs), count=2)
    _, outcome = next(running)
    running.close()
    assert outcome.result is not None
    with pytest.raises(ProcessLookupError):
        os.kill(outcome.result.payload.process, 0)


def test_no_more_is_read_ahead_than_is_done(tmp_path: Path) -> None:
    taken = 0

    def jobs() -> Iterator[Job[float]]:
        nonlocal taken
        for index in range(9):
            taken += 1
            yield Job(index=index, path=tmp_path / "a.txt", target=0.0)

    (tmp_path / "a.txt").write_text("a")
    running = outcomes(CountWork(), jobs(), in_this_process)
    next(running)
    assert taken == 1
    running.close()


def test_frames_that_a_video_only_announces_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    video = announcing(monkeypatch, write_video(tmp_path / "clip.mp4", 12), 15)
    numbers = enumerate((3, 11, 12, 14, 15))
    jobs = [Job(index=index, path=video / f"{number:06d}", target=0.0) for index, number in numbers]
    found = list(outcomes(CountWork(), jobs, in_this_process))
    assert [job.index for job, _ in found] == [0, 1, 4]
    assert all(one.result is not None and one.result.payload.length > 64 * 80 * 3 for _, one in found[:2])
    assert "has 15 frames, none of number 15" in found[2][1].error
