"""The work on one photograph, as far as the commands share it: how it is estimated, by which network.

The network is loaded once in each process: bytes do not depend on its threads.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from multiprocessing import parent_process
from pathlib import Path
from typing import Any

from blur2view.arrays import Array
from blur2view.cli.arguments.shared import PhotographOptions
from blur2view.errors import Blur2ViewError, RunError
from blur2view.exposure.features import Features, features_of, match_features
from blur2view.exposure.sequence import in_time
from blur2view.exposure.time_direction import neighbour_motion
from blur2view.images.image import read_image
from blur2view.images.timestamps import timestamp_of
from blur2view.networks.model_file import usable_cores
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import FileEstimate, estimate_file
from blur2view.results.table import Row
from blur2view.runs.job import Job, Outcome, file_digest

Content = tuple[Path, bytes]  # of a photograph


@lru_cache(maxsize=1)
def network_of(model: str | None, provider: str | None, digest: str) -> SmearNetwork:
    """Return the smear network of this process, loaded once; processes beside others have a core each.

    RunError if another file than that of the digest has its name here, as on a machine of a cluster.
    """
    threads = usable_cores() if parent_process() is None else 1
    loaded = SmearNetwork(model, threads=threads, providers=() if provider is None else (provider,))
    if file_digest(loaded.path) != digest:
        raise RunError(f"{loaded.path}: is another network on a worker; install the same blur2view there")
    return loaded


def estimated(options: PhotographOptions, job: Job, **how: Any) -> FileEstimate:
    """Return the estimate of a photograph, in the order in time that its neighbours decide.

    ``how`` is what `estimate_file` may be told besides.
    """
    network = network_of(options.model, options.provider, options.digest)
    one = estimate_file(job.path, network, options.run, job.content, **how)
    time_s = timestamp_of(job.path) if job.timestamp_s is None else job.timestamp_s
    one = replace(one, frame=job.frame, timestamp_s=time_s, timed=options.timings)
    if not job.neighbours:
        return one
    motions, camera, here = [], one.estimate.camera, (job.path, job.encoded)
    for neighbour in job.neighbours:
        with suppress(Blur2ViewError):  # of one that cannot be read, which has a line of its own
            there = neighbour.path, neighbour.encoded
            pair = (there, here) if neighbour.steps < 0 else (here, there)
            own, other = _matched(*pair, options.max_memory)[:: neighbour.steps]
            motions.append(neighbour_motion(own, other, neighbour.steps, camera))
    return replace(one, estimate=in_time(one.estimate, motions))


def outcome_of(
    one: FileEstimate, payload: Any, summary: str, files: Mapping[Path, bytes] | None = None
) -> Outcome:
    """Return what the work on a photograph gives, with its row and its warnings."""
    return Outcome(
        payload=payload, summary=summary, row=Row.of(one), files=files or {}, warnings=one.warnings
    )


@lru_cache(maxsize=2)
def _matched(earlier: Content, later: Content, max_memory_gib: float) -> tuple[Array, Array]:
    """Return matched pixels of two photographs, which each of them asks for."""
    first, second = (_features(*one, max_memory_gib) for one in (earlier, later))
    return match_features(first, second)


@lru_cache(maxsize=3)
def _features(path: Path, content: bytes, max_memory_gib: float) -> Features:
    return features_of(read_image(path, max_memory_gib=max_memory_gib, content=content))
