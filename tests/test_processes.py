"""Processes that are started: they end when they are told to, and with their parent, however it ends."""

import multiprocessing
import subprocess
import sys
import time

import pytest

from blur2view.processes import processes, spawn_context
from tests.support.many_photographs import environment

KILLED = """
import os, signal, time
from blur2view.processes import processes, spawn_context

stop, end = spawn_context().Pipe(duplex=False)
pools = processes(1), processes(1, stop=stop)
print(*[pool.submit(os.getpid).result() for pool in pools], flush=True)
for pool in pools:
    pool.submit(time.sleep, 600)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.slow
def test_processes_end_when_they_are_told_to_whatever_they_are_doing() -> None:
    others, (stop, end) = multiprocessing.active_children(), spawn_context().Pipe(duplex=False)
    pool = processes(2, stop=stop)
    for _ in range(2):
        pool.submit(time.sleep, 120)
    started = {*multiprocessing.active_children()} - {*others}
    end.close()
    for process in started:
        process.join(100)
    stop.close()
    codes = [process.exitcode for process in started]  # the pool terminates the second one, if it is later
    assert len(codes) == 2 and 1 in codes and not {0, None} & {*codes}


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signal")
def test_processes_end_with_their_parent_that_is_killed() -> None:
    done = subprocess.run(  # which waits for all that may print there
        [sys.executable, "-c", KILLED], env=environment(), stdout=subprocess.PIPE, timeout=300
    )
    assert done.returncode == -9 and len(done.stdout.split()) == 2
