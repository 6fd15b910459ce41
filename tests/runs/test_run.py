"""Jobs in this process and in several: order, failures, processes that die, modules of the current folder."""

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from blur2view.errors import ImageError
from blur2view.images.source import Source
from blur2view.results.photograph import Photograph
from blur2view.runs import executors
from blur2view.runs.executors import executor, in_processes
from blur2view.runs.jobs import Executor, Job, Outcome, content_of, neighbours_of, outcomes


@dataclass
class CountWork:
    """Counts the bytes of a file; the first take longest, and a word in the file makes it fail or die."""

    pause_s: float = 0.0
    count: int = 0

    def __call__(self, job: Job) -> Outcome:
        """Return the process and the number of bytes."""
        content = content_of(job)
        time.sleep(self.pause_s * max(self.count - job.index, 0))
        if content == b"fail":
            raise ImageError(f"{job.source}: fails")
        if content == b"die":
            os._exit(9)
        besides = {"process": os.getpid(), "bytes": len(content)}
        return Outcome(photograph=Photograph(name=job.name), besides=besides)


def results(run: Executor, folder: Path, words: list[str], pause_s: float = 0.0) -> list[Outcome]:
    """Return the outcomes of files that hold these words, which come in the order of the files."""
    jobs = []
    for index, word in enumerate(words):
        (path := folder / f"{index}.txt").write_text(word)
        jobs.append(Job(index=index, source=Source(path=path), name=path.name))
    found = list(outcomes(CountWork(pause_s=pause_s, count=len(words)), jobs, run))
    assert [job.index for job, _ in found] == list(range(len(words)))
    return [outcome for _, outcome in found]


def lengths(found: list[Outcome]) -> list[int | None]:
    """Return the numbers of bytes, None of what failed."""
    return [None if one.error else one.besides["bytes"] for one in found]


@pytest.mark.slow
def test_results_of_several_processes_come_in_order(tmp_path: Path) -> None:
    found = results(executor(2), tmp_path, ["a", "bb", "fail", "dddd", "eeeee"], pause_s=0.05)
    assert lengths(found) == [1, 2, None, 4, 5]
    others = {one.besides["process"] for one in found if not one.error}
    assert len(others) == 2 and os.getpid() not in others


@pytest.mark.slow
def test_process_that_dies_costs_the_photograph_that_killed_it(tmp_path: Path) -> None:
    found = results(executor(2), tmp_path, ["a", "bb", "die", "dddd", "eeeee", "ffffff"])
    assert lengths(found) == [1, 2, None, 4, 5, 6]
    assert "2.txt: the process that read it died" in found[2].error


@pytest.mark.slow
def test_no_process_is_left_when_a_run_is_abandoned(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("a")
    jobs = [Job(index=n, source=Source(path=tmp_path / "a.txt")) for n in range(50)]
    running = in_processes(CountWork(), iter(jobs), count=2)
    _, outcome = next(running)
    running.close()
    with pytest.raises(ProcessLookupError):
        os.kill(outcome.besides["process"], 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pickle.py", "signal.py", "struct.py", "re.py"])
def test_processes_run_no_module_of_the_current_folder(here: Path, name: str) -> None:
    (here / name).write_text(f"open({str(here / 'ran')!r}, 'w').close()")
    assert lengths(results(executor(2), here, ["a", "bb"])) == [1, 2]
    assert not (here / "ran").exists()


def _beside(paths: Sequence[Path], sequence: bool | None) -> list[list[tuple[int, Path]]]:
    """Return the steps to the neighbours of each photograph, and where they are."""
    found = neighbours_of([Source(path=path) for path in paths], sequence)
    return [[(one.steps, one.source.path) for one in near] for near in found]


def test_neighbours_are_named_beside_a_photograph_and_lie_in_its_folder() -> None:
    first, second, elsewhere = paths = [Path("a/1.png"), Path("a/2.png"), Path("b/1.png")]
    assert _beside(paths, True) == [[(1, second)], [(-1, first)], []]
    assert _beside([elsewhere, first, second], True) == [[], [(1, second)], [(-1, first)]]
    assert _beside(paths, None) == [[], [], []]
    frames = [Source(path=Path("v.mp4"), frame=frame) for frame in (0, 5)]
    steps = [[(one.steps, one.source.frame) for one in near] for near in neighbours_of(frames, None)]
    assert steps == [[(1, 1)], [(-1, 4), (1, 6)]] and neighbours_of(frames, False) == [(), ()]


def test_processes_search_no_module_in_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(["", ".", str(tmp_path / "else")]))
    assert executors._search_path() == str(tmp_path / "else")
