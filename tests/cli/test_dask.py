"""``--dask``: the same bytes from two processes, one of which is killed; nobody at the address."""

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from blur2view.cli.batch import executors, schedule
from blur2view.cli.batch.job import Job, Outcome
from blur2view.errors import RunError
from blur2view.exposure.sequence import NO_FEATURES
from blur2view.images.inputs import Source
from blur2view.records.record import Record
from tests.cli.test_ended_early import wait_for
from tests.support.calls import Call, call_program
from tests.support.many_photographs import contents, environment, start, write_photographs

pytest.importorskip("distributed", reason="--dask needs the extra dask")
pytestmark = pytest.mark.slow
Processes = list[subprocess.Popen[bytes]]
Cluster = tuple[str, Processes]


def start_cluster(folder: Path) -> Cluster:
    """Return the address of a scheduler, it and its two workers."""
    file = folder / "scheduler.json"
    shared = ["--scheduler-file", str(file), "--no-dashboard"]

    def run(name: str, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.dask_{name}", *shared, *words]
        return subprocess.Popen(
            command, env=environment(), cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    processes = [run("scheduler", "--port", "0", "--host", "127.0.0.1")]
    while not file.exists() or not file.read_text().endswith("}"):
        assert processes[0].poll() is None
        time.sleep(0.05)
    address = next(word for word in file.read_text().split('"') if word.startswith("tcp://"))
    processes += [run("worker", "--nthreads", "1", "--no-nanny") for _ in range(2)]
    return address, processes


@pytest.fixture(scope="module")
def clusters() -> Iterator[list[Cluster]]:
    """Yield the clusters that have been started, which end with the tests."""
    started = list[Cluster]()
    yield started
    for _, processes in started:
        for process in processes:
            process.kill()
            process.wait()


@pytest.fixture
def cluster(clusters: list[Cluster], tmp_path: Path) -> Cluster:
    """Return a cluster, of which each test kills a process: a new one if the scheduler was killed."""
    if not clusters or clusters[-1][1][0].poll() is not None:
        clusters.append(start_cluster(tmp_path))
    return clusters[-1]


def test_killed_worker_costs_time_only_and_bytes_are_those_of_one_process(
    cluster: Cluster, run: Call, tmp_path: Path, tiny_model: Path
) -> None:
    address, (_, *workers) = cluster
    write_photographs(tmp_path / "in", 20)
    assert run(tmp_path / "in", "-o", tmp_path / "here") == 0
    words = ["estimate", tmp_path / "in", "--model", tiny_model, "--dask", address]
    running = start(*words, "-o", tmp_path / "out", gate=tmp_path / "gate")
    wait_for(running, tmp_path / "out", 4)
    workers[0].kill()
    (tmp_path / "gate").touch()
    printed, complaints = running.communicate()
    assert running.returncode == 0 and complaints == ""
    assert printed.splitlines()[-1].startswith("20 photographs: 20 done (")
    assert contents(tmp_path / "out") == contents(tmp_path / "here")


def test_a_scheduler_that_dies_is_one_line_and_the_call_goes_on_without_it(
    cluster: Cluster, run: Call, tmp_path: Path, tiny_model: Path
) -> None:
    address, (scheduler, *_) = cluster
    write_photographs(tmp_path / "in", 20)
    words = [tmp_path / "in", "-o", tmp_path / "out"]
    dask = ["--dask", address]
    running = start("estimate", *words, "--model", tiny_model, *dask, gate=tmp_path / "gate")
    wait_for(running, tmp_path / "out", 4)
    scheduler.kill()
    scheduler.wait()
    (tmp_path / "gate").touch()
    _, complaints = running.communicate()
    assert running.returncode == 1 and complaints.count("\n") == 2, complaints
    assert (
        f"{address}: cannot go on (" in complaints
        and "the same call with --resume does the rest" in complaints
    )
    done = run(*words, "--resume")
    assert done == 0 and " done before (" in done.out


def test_nobody_at_the_address_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(executors, "CONNECT_S", 1)
    (photograph,) = write_photographs(tmp_path, 1)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        for port in (9, silent.getsockname()[1]):
            address, start_s = f"tcp://127.0.0.1:{port}", time.monotonic()
            done = call_program(capsys, "estimate", photograph, "--dask", address)
            assert done == 1 and done.out == ""
            assert f"{address}: no Dask scheduler answers" in done.line
            assert time.monotonic() - start_s < 60  # and not for ever


def test_whoever_waits_for_workers_that_all_died_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    class Client:
        def nthreads(self) -> dict[str, int]:
            return {}

        def wait_for_workers(self, count: int, timeout: float) -> None:
            raise TimeoutError

        def get_executor(self, **_: object) -> ThreadPoolExecutor:
            return ThreadPoolExecutor(1)

        def close(self) -> None:
            pass

    def work(job: Job) -> Outcome:
        ended.wait()
        return Outcome(record=Record(name=job.name))

    ended = threading.Event()
    monkeypatch.setattr(executors, "ANSWER_S", 0.01)
    monkeypatch.setattr(schedule, "connected", lambda address: (Client(), RuntimeError))
    every = [Job(source=Source(path=Path(__file__)))]
    series = schedule.in_cluster(work, every, lambda _: None, lambda *_: NO_FEATURES, address="tcp://a:1")
    with pytest.raises(
        RunError, match="tcp://a:1: the Dask scheduler has no worker; start one with: dask worker tcp://a:1"
    ):
        try:
            next(series)
        finally:
            ended.set()  # or its thread would wait for ever
