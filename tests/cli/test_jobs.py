"""Jobs in this process and in several: order, failures, processes that die, modules of the current folder."""

import os
import pickle
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blur2view.cli.batch import photograph, schedule
from blur2view.cli.batch.executors import Shared, as_it_is
from blur2view.cli.batch.job import Job, Outcome, neighbours_in_time
from blur2view.cli.batch.schedule import in_processes
from blur2view.errors import ImageError
from blur2view.exposure import sequence
from blur2view.exposure.sequence import MAX_FEATURES, NO_FEATURES, Features, extract_features
from blur2view.images import inputs
from blur2view.images.image import Content
from blur2view.images.inputs import Source
from blur2view.records.record import Record
from tests.support.calls import Call
from tests.support.many_photographs import write_video


class CountWork:
    """Counts the bytes of a file; a word in it makes it fail or die, or wait until the others are counted."""

    def __call__(self, job: Job) -> Outcome:
        """Return the process and the number of bytes."""
        while job.content == b"wait" and not (job.source.path.parent / "last").exists():
            time.sleep(0.01)
        if job.content == b"last":
            (job.source.path.parent / "last").touch()
        if job.content == b"fail":
            raise ImageError(f"{job.source}: fails")
        if job.content == b"die":
            os._exit(9)
        return Outcome(record=Record(name=job.name), summary=f"{os.getpid()} {len(job.content or b'')}")


def nothing(source: Source, content: Content) -> Features:
    """Return no features."""
    return NO_FEATURES


def results(folder: Path, *words: str, processes: int = 2) -> list[Outcome]:
    """Return the outcomes of files that hold these words, which come in the order of the files."""
    every = []
    for index, word in enumerate(words):
        (path := folder / f"{index}.txt").write_text(word)
        every.append(Job(source=Source(path=path), name=path.name))
    found = list(in_processes(CountWork(), every, lambda job: None, nothing, count=processes))
    assert [job.name for job, _ in found] == [job.name for job in every]
    return [outcome for _, outcome in found]


def lengths(found: list[Outcome]) -> list[int | None]:
    """Return the numbers of bytes, None of what failed."""
    return [None if one.error else int(one.summary.split()[1]) for one in found]


@pytest.mark.slow
@pytest.mark.parametrize(("processes", "first"), [(1, "a"), (2, "wait")])
def test_results_come_in_order(tmp_path: Path, processes: int, first: str) -> None:
    found = results(tmp_path, first, "bb", "fail", "ddddd", "last", processes=processes)
    assert lengths(found) == [len(first), 2, None, 5, 4]
    workers = {int(one.summary.split()[0]) for one in found if not one.error}
    assert len(workers) == processes and (os.getpid() in workers) == (processes == 1)


@pytest.mark.slow
def test_process_that_dies_costs_the_photograph_that_killed_it(tmp_path: Path) -> None:
    found = results(tmp_path, "a", "die", "ccc", "dddd")
    assert lengths(found) == [1, None, 3, 4]
    assert "1.txt: the process that read it died" in found[1].error


@pytest.mark.slow
def test_processes_run_no_module_of_the_current_folder(here: Path) -> None:
    for name in ("pickle.py", "signal.py", "struct.py", "re.py"):
        (here / name).write_text(f"open({str(here / 'ran')!r}, 'w').close()")
    assert lengths(results(here, "a", "bb")) == [1, 2]
    assert not (here / "ran").exists()


def test_neighbours_are_named_beside_a_photograph_and_lie_in_its_folder() -> None:
    names = ("a/1.png", "a/2.png", "b/1.png")
    first, second, elsewhere = stills = [Source(path=Path(name)) for name in names]
    assert neighbours_in_time(stills, True) == [((1, second),), ((-1, first),), ()]
    assert neighbours_in_time([elsewhere, first, second], True) == [(), ((1, second),), ((-1, first),)]
    assert neighbours_in_time(stills, None) == [(), (), ()]
    frames = [Source(path=Path("v.mp4"), frame=frame) for frame in (0, 5)]
    steps = [[(steps, one.frame) for steps, one in near] for near in neighbours_in_time(frames, None)]
    assert steps == [[(1, 1)], [(-1, 4), (1, 6)]] and neighbours_in_time(frames, False) == [(), ()]


@pytest.mark.parametrize("count", [1, 4])
def test_each_frame_of_a_video_is_read_and_described_once_and_each_pair_matched_once(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    names = list[str]()

    def counted(module: object, name: str) -> None:
        function = getattr(module, name)

        def note(*words: Any, **options: Any) -> Any:
            names.append(name)  # which no other thread divides
            return function(*words, **options)

        monkeypatch.setattr(module, name, note)

    counted(photograph, "extract_features")
    counted(sequence, "match_features")
    counted(inputs, "read_frame")
    monkeypatch.setattr(schedule, "processes", ThreadPoolExecutor)  # processes would count by themselves
    monkeypatch.setattr(schedule, "Shared", as_it_is)
    assert call("estimate", write_video(tmp_path / "clip.mp4", 12), "--jobs", count, "-q") == 0
    asked = Counter(names)
    assert asked["extract_features"] == 12 and asked["match_features"] == 11
    assert asked["read_frame"] <= 14  # with those that would be behind the last


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere contents go through a pipe")
def test_a_frame_of_720p_costs_a_pipe_less_than_a_megabyte() -> None:
    noise = np.random.default_rng(0).random((360, 640, 3), np.float32).repeat(2, 0).repeat(2, 1)
    features = extract_features(noise)
    content = np.ascontiguousarray(255 * noise, np.uint8).tobytes()
    shared = Shared(content)
    sent = pickle.dumps(shared)
    most = len(pickle.dumps(features)) / len(features[0]) * MAX_FEATURES
    assert len(features[0]) > 500 and most + 2 * len(sent) < 1e6
    assert pickle.loads(sent) == content
