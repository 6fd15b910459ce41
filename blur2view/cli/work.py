"""The work on one photograph, as far as the commands share it: how it is estimated, by which network.

The network is loaded once in each process: bytes do not depend on its threads.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from multiprocessing import parent_process
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

from blur2view import __version__
from blur2view.arrays import Array
from blur2view.camera.intrinsics import Intrinsics
from blur2view.cli.arguments.shared import PhotographOptions
from blur2view.cli.terminal import TILE, Progress
from blur2view.colmap.cameras import StoredCamera
from blur2view.errors import Blur2ViewError, RunError
from blur2view.exposure.neighbours import Features, features_of, match_features
from blur2view.exposure.sequence import in_time
from blur2view.exposure.time_direction import neighbour_motion
from blur2view.input_files import parse_json, read_regular
from blur2view.networks.model_file import model_path, usable_cores
from blur2view.networks.smear_network import Detail, SmearNetwork
from blur2view.output_files import ResultFiles
from blur2view.photographs.image import read_image
from blur2view.photographs.timestamps import timestamp_of
from blur2view.pipeline import CameraOf, FileEstimate, Run, estimate_file
from blur2view.results.document import Document
from blur2view.results.stored import plain, restore
from blur2view.results.table import Row
from blur2view.runs.job import Job, Payload, Result, Target, Work, file_digest
from blur2view.runs.manifest import Settings

Written = TypeVar("Written", bound=Document)


@dataclass(frozen=True, kw_only=True)
class CommandNetwork:
    """The network, as it goes to the processes that run it.

    What --model and --provider name, and the file's SHA-256.
    """

    model: str | None
    digest: str
    provider: str | None = None

    @classmethod
    def of(cls, model: str | None, provider: str | None = None) -> Self:
        """Return that of the options, loaded to see that it can be; its tiles are shown to a person."""
        path = model_path(model)
        digest = file_digest(path) if path.is_file() else ""
        network = cls(model=model, digest=digest, provider=provider)
        network.loaded.on_tile = Progress(TILE).show  # or it says what is wrong
        network.loaded.tiles_at_once = usable_cores()  # here alone
        return network

    @property
    def loaded(self) -> SmearNetwork:
        """Return the smear network of this process; RunError if another file has its name there."""
        return _loaded(self)


@lru_cache(maxsize=1)
def _loaded(network: CommandNetwork) -> SmearNetwork:
    """Return the smear network, loaded once; processes beside others have a core each."""
    threads = usable_cores() if parent_process() is None else 1
    providers = () if network.provider is None else (network.provider,)
    loaded = SmearNetwork(network.model, threads=threads, providers=providers)
    if file_digest(loaded.path) != network.digest:  # as a machine of a cluster may have
        raise RunError(f"{loaded.path}: is another network on a worker; install the same blur2view there")
    return loaded


@dataclass(frozen=True, kw_only=True)
class EstimatingWork(Work[Target, Payload]):
    """Work that begins with the estimate of a photograph."""

    run: Run
    network: CommandNetwork
    timings: bool
    verbosity: int

    @classmethod
    def of(cls, options: PhotographOptions) -> Self:
        """Return the work, of what has its names in the options of a command, after loading the network."""
        own = {one.name: getattr(options, one.name) for one in fields(cls) if one.name != "network"}
        return cls(network=CommandNetwork.of(options.model, options.provider), **own)

    def estimated(
        self,
        job: Job[Target],
        *,
        as_stored: bool = False,
        camera_of: CameraOf | None = None,
        detail: Detail = Detail.GEOMETRY,
    ) -> FileEstimate:
        """Return the estimate of a photograph, in the order in time that its neighbours decide."""
        one = estimate_file(
            job.path,
            self.network.loaded,
            self.run,
            job.content,
            as_stored=as_stored,
            camera_of=camera_of,
            detail=detail,
        )
        time_s = timestamp_of(job.path) if job.timestamp_s is None else job.timestamp_s
        one = replace(one, frame=job.frame, timestamp_s=time_s, timed=self.timings)
        if not job.neighbours:
            return one
        motions, camera, here = [], one.estimate.camera, (job.path, job.encoded)
        for neighbour in job.neighbours:
            with suppress(Blur2ViewError):  # of one that cannot be read, which has a line of its own
                there = neighbour.path, neighbour.encoded
                pair = (there, here) if neighbour.steps < 0 else (here, there)
                own, other = _matched(*pair, self.run.max_memory_gib)[:: neighbour.steps]
                motions.append(neighbour_motion(own, other, neighbour.steps, camera))
        return replace(one, estimate=in_time(one.estimate, motions))


def result_of(
    one: FileEstimate, payload: Payload, summary: str, files: Mapping[Path, bytes] | None = None
) -> Result[Payload]:
    """Return what the work on a photograph gives, with its row and its warnings."""
    return Result(payload=payload, summary=summary, row=Row.of(one), files=files or {}, warnings=one.warnings)


@dataclass(frozen=True, kw_only=True)
class DocumentWork(EstimatingWork[ResultFiles | None, Written | None]):
    """Work whose document is written beside other files, and kept where it is printed."""

    kind: ClassVar[Any]  # type of the document
    prints_documents: bool

    def restored(self, job: Job[ResultFiles | None], stored: Any) -> Written | None:
        """Return the document that an earlier call has written."""
        if not self.prints_documents or job.target is None:
            return None
        content = parse_json(read_regular(job.target.document))
        document: Written = restore(self.kind, content)
        return document


Content = tuple[Path, bytes]  # of a photograph


@lru_cache(maxsize=2)
def _matched(earlier: Content, later: Content, max_memory_gib: float) -> tuple[Array, Array]:
    """Return matched pixels of two photographs, which each of them asks for."""
    first, second = (_features(*one, max_memory_gib) for one in (earlier, later))
    return match_features(first, second)


@lru_cache(maxsize=3)
def _features(path: Path, content: bytes, max_memory_gib: float) -> Features:
    return features_of(read_image(path, max_memory_gib=max_memory_gib, content=content))


NOT_OF_A_RESULT = {"verbosity", "prints_documents", "max_memory_gib", "model", "db"}
"""What a work holds besides that on which results depend; the network's file stands for its name."""


def settings_of(command: str, work: object, intrinsics: Intrinsics) -> Settings:
    """Return all that a work holds on which the results depend, and the digest of the camera's file."""
    options = _without(plain(work))
    camera = intrinsics.camera
    files = [camera.database] if isinstance(camera, StoredCamera) and camera.database.is_file() else []
    options["camera_files"] = [file_digest(path) for path in files]
    return Settings(command=command, version=__version__, options=options)


def _without(stored: dict[str, Any]) -> dict[str, Any]:
    kept = {name: value for name, value in stored.items() if name not in NOT_OF_A_RESULT}
    return {name: _without(value) if isinstance(value, dict) else value for name, value in kept.items()}
