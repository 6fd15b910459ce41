"""The work on one photograph, as far as the commands share it: how it is estimated, by which network.

The network is loaded once in each process: bytes do not depend on its threads.
"""

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import lru_cache
from multiprocessing import parent_process
from typing import Any

from blur2view import __version__
from blur2view.arrays import Array
from blur2view.cli.options import Estimating, Lens, Rates
from blur2view.errors import Blur2ViewError, RunError
from blur2view.exposure.features import Features, features_of, match_features
from blur2view.exposure.sequence import in_time
from blur2view.exposure.time_direction import neighbour_motion
from blur2view.images.image import read_image
from blur2view.images.source import Source
from blur2view.images.timestamps import timestamp_of
from blur2view.networks.model_file import model_path, usable_cores
from blur2view.networks.smear_network import SmearNetwork
from blur2view.output_files import file_digest
from blur2view.pipeline import FileEstimate, Run, estimate_file
from blur2view.results.photograph import Photograph
from blur2view.runs.job import Job, content_of

Content = tuple[Source, bytes]


@dataclass(frozen=True, kw_only=True)
class Setup:
    """How every photograph of a call is estimated, in whichever process.

    Parameters
    ----------
    run : Run
        The options of the estimate.
    estimating : Estimating
        Those of the network.
    network_sha256 : str
        Of the network's file.
    options_sha256 : str
        Of the command and of every option that results depend on.
    """

    run: Run
    estimating: Estimating
    network_sha256: str
    options_sha256: str

    @classmethod
    def of(cls, command: str, options: Any) -> "Setup":
        """Return the setup of a command with these options, which have groups of the names used here."""
        estimating: Estimating = options.estimating
        lens: Lens = options.lens
        rates: Rates = getattr(options, "rates", Rates())
        path, camera = model_path(estimating.model), lens.database
        digest = file_digest(path) if path.is_file() else ""
        files = [digest, file_digest(camera) if camera is not None and camera.is_file() else ""]
        run = Run(
            select=estimating.select(),
            options=estimating.options(),
            seed=estimating.seed,
            intrinsics=lens.intrinsics(),
            exposure_s=rates.exposure,
            readout_s=rates.readout,
            max_memory_gib=options.reading.max_memory,
            gyroscope=rates.gyroscope,
        )
        settings = [command, __version__, files, _settings(options)]
        return cls(run=run, estimating=estimating, network_sha256=digest, options_sha256=_sha256(settings))

    def network(self) -> SmearNetwork:
        """Return the smear network of this process, loaded once; ModelError if it cannot be used."""
        return _network(self.estimating.model, self.estimating.provider, self.network_sha256)

    def estimated(self, job: Job, **how: Any) -> FileEstimate:
        """Return the estimate of a photograph, in the order in time that its neighbours decide.

        ``how`` is what `estimate_file` may be given besides.
        """
        one = estimate_file(job.source, self.network(), self.run, job.content, **how)
        if not job.neighbours:
            return one
        motions, camera, here = [], one.estimate.camera, (job.source, content_of(job))
        for near in job.neighbours:
            with suppress(Blur2ViewError):  # of one that cannot be read, which has a line of its own
                there = near.source, content_of(near)
                pair = (there, here) if near.steps < 0 else (here, there)
                own, other = _matched(*pair, self.run.max_memory_gib)[:: near.steps]
                motions.append(neighbour_motion(own, other, near.steps, camera))
        return replace(one, estimate=in_time(one.estimate, motions))

    def key(self, job: Job) -> str:
        """Return the digest of all that the result of a photograph depends on besides its file."""
        return _sha256([self.options_sha256, job.depends_on])

    def record(
        self, one: FileEstimate, job: Job, *, seconds: Mapping[str, float] | None = None, **stated: Any
    ) -> Photograph:
        """Return the record of an estimate, with ``stated`` fields and the ``seconds`` of further steps."""
        time_s = timestamp_of(job.source.name) if job.source.time_s is None else job.source.time_s
        steps = {name.removesuffix("_s"): value for name, value in vars(one.estimate.timings).items()}
        timings = {"read": one.read_s, **steps, **(seconds or {})}
        known = {
            "frame": job.source.frame,
            "timestamp_s": time_s,
            "exposure_s": one.exposure_s,
            "gyroscope": self.run.gyroscope,
            "beta": self.estimating.beta,
            "max_error_px": self.estimating.max_error,
            "seed": self.estimating.seed,
            "version": __version__,
            "input_sha256": job.input_sha256,
            "options_sha256": self.key(job),
            "timings_s": timings if self.estimating.timings else None,
        }
        return Photograph.of(one.estimate, name=job.name, **known | stated)


def _settings(options: Any) -> dict[str, Any]:
    """Return the values of a dataclass of options by their names, of groups that have an effect alone."""
    settings: dict[str, Any] = {}
    for one in fields(options):
        value = getattr(options, one.name)
        if not is_dataclass(one.type):
            settings[one.name] = value
        elif getattr(one.type, "effect", True):
            settings[one.name] = _settings(value)
    return settings


def _sha256(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()


@lru_cache(maxsize=1)
def _network(model: str | None, provider: str | None, digest: str) -> SmearNetwork:
    """Return the smear network of this process; processes beside others have a core each.

    RunError if another file than that of the digest has its name here, as on a machine of a cluster.
    """
    threads = usable_cores() if parent_process() is None else 1
    loaded = SmearNetwork(model, threads=threads, providers=() if provider is None else (provider,))
    if file_digest(loaded.path) != digest:
        raise RunError(f"{loaded.path}: is another network on a worker; install the same blur2view there")
    return loaded


@lru_cache(maxsize=2)
def _matched(earlier: Content, later: Content, max_memory_gib: float) -> tuple[Array, Array]:
    """Return matched pixels of two photographs, which each of them asks for."""
    first, second = (_features(*one, max_memory_gib) for one in (earlier, later))
    return match_features(first, second)


@lru_cache(maxsize=3)
def _features(source: Source, content: bytes, max_memory_gib: float) -> Features:
    return features_of(read_image(source.path, max_memory_gib=max_memory_gib, content=content))
