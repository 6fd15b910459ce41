"""The work on one photograph, as far as the commands share it: how it is estimated, by which network.

The network is loaded once in each process: bytes do not depend on its threads.
"""

import hashlib
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache
from multiprocessing import parent_process
from pathlib import Path
from typing import Any

import numpy as np

from blur2view import __version__
from blur2view.arrays import AnyArray, Array
from blur2view.camera.camera import Camera
from blur2view.camera.intrinsics import ExifValues, disagreement, read_exif
from blur2view.cli.options import Common, InTime
from blur2view.errors import Blur2ViewError, CameraError, RunError
from blur2view.exposure.features import Features, features_of, match_features
from blur2view.exposure.sequence import in_time
from blur2view.exposure.time_direction import neighbour_motion
from blur2view.geometry.rolling_shutter import RollingShutter
from blur2view.images.image import read_image, read_pixels
from blur2view.images.source import Source, timestamp_of
from blur2view.images.video import rows_towards
from blur2view.networks.model_file import model_path, usable_cores
from blur2view.networks.protocol import Detail
from blur2view.networks.smear_network import SmearNetwork
from blur2view.output_files import file_digest
from blur2view.pipeline import Estimate, estimate
from blur2view.results.photograph import Photograph
from blur2view.runs.jobs import Job

Content = tuple[Source, bytes]
CameraOf = Callable[[Path, tuple[int, int], ExifValues], Camera | None]  # path, width and height, EXIF


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimated:
    """The estimate of a photograph's file, and what the file alone says."""

    estimate: Estimate
    image: AnyArray  # (H, W, 3), as of `read_pixels`, upright unless wanted as stored
    exposure_s: float | None  # of the options or else of EXIF
    warnings: tuple[str, ...]  # of options that EXIF contradicts


@dataclass(frozen=True, kw_only=True)
class Setup:
    """How every photograph of a call is estimated, in whichever process.

    Parameters
    ----------
    common, in_time : Common, InTime
        The options of every command; those of exposure and order in time.
    network_sha256 : str
        Of the network's file.
    options_sha256 : str
        Of the command and of every option that results depend on.
    """

    common: Common
    in_time: InTime
    network_sha256: str
    options_sha256: str

    @classmethod
    def of(cls, command: str, options: Any) -> "Setup":
        """Return the setup of a command with these options, which have groups of the names used here."""
        common: Common = options.common
        files = [model_path(common.estimating.model), common.lens.database]
        digests = [file_digest(one) if one is not None and one.is_file() else "" for one in files]
        return cls(
            common=common,
            in_time=getattr(options, "in_time", InTime(sequence=getattr(options, "sequence", False))),
            network_sha256=digests[0],
            options_sha256=_sha256([command, __version__, digests, _settings(options)]),
        )

    def network(self) -> SmearNetwork:
        """Return the smear network of this process, loaded once; ModelError if it cannot be used."""
        estimating = self.common.estimating
        return _network(estimating.model, estimating.provider, self.network_sha256)

    def estimated(
        self,
        job: Job,
        *,
        as_stored: bool = False,
        camera_of: CameraOf | None = None,
        detail: Detail = Detail.GEOMETRY,
    ) -> Estimated:
        """Return the estimate of a photograph, in the order in time that its neighbours decide.

        Each has a generator of its own, so that its result does not depend on those before it. ``as_stored``
        is as of `read_image`, ``detail`` of `estimate`; ``camera_of`` gives intrinsics, by default those of
        options or EXIF. ImageError, CameraError or ModelError if one cannot be used.
        """
        estimating, lens, exposure_s = self.common.estimating, self.common.lens, self.in_time.exposure
        path = Path(str(job.source))
        image = read_pixels(path, as_stored=as_stored, content=job.content)
        exif = read_exif(path, job.content)
        camera = (camera_of or lens.intrinsics().of)(path, (image.shape[1], image.shape[0]), exif)
        found = estimate(
            image,
            network=self.network(),
            select=estimating.select(),
            options=estimating.options(),
            rng=np.random.default_rng(estimating.seed),
            camera=camera,
            shutter=self._shutter(job.source, exif),
            detail=detail,
        )
        focal_px = camera.focal_px if camera else None
        return Estimated(
            estimate=self._in_time(found, job, as_stored),
            image=image,
            exposure_s=exposure_s or exif.exposure_s,
            warnings=(  # an option is believed all the same
                *disagreement("--exposure", exposure_s, exif.exposure_s, "s"),
                *disagreement(lens.intrinsics().stated, focal_px, exif.focal_px, "px"),
            ),
        )

    def _shutter(self, source: Source, exif: ExifValues) -> RollingShutter | None:
        """Return the rolling shutter of a photograph, None where the options name none."""
        if not self.in_time.readout:
            return None
        if (exposure_s := self.in_time.exposure or exif.exposure_s) is None:
            raise CameraError(
                f"{source}: --readout needs the exposure time, EXIF names none; add --exposure S"
            )
        towards = exif.rows_towards if source.frame is None else rows_towards(source.path)
        return RollingShutter(readout_s=self.in_time.readout, exposure_s=exposure_s, towards=towards)

    def _in_time(self, found: Estimate, job: Job, as_stored: bool) -> Estimate:
        """Return an estimate in the order that the photographs before and after it decide."""
        motions, here = [], (job.source, job.content)
        for steps, near in job.neighbours:
            if near not in job.contents:  # it cannot be read, and has a line of its own
                continue
            with suppress(Blur2ViewError):  # likewise
                there = near, job.contents[near]
                pair = (there, here) if steps < 0 else (here, there)
                own, other = _matched(*pair, as_stored)[::steps]
                motions.append(neighbour_motion(own, other, steps, found.camera))
        return in_time(found, motions) if job.neighbours else found

    def key(self, job: Job) -> str:
        """Return the digest of all that the result of a photograph depends on besides its file."""
        return _sha256([self.options_sha256, job.depends_on])

    def record(self, one: Estimated, job: Job, **stated: Any) -> Photograph:
        """Return the record of an estimate, with ``stated`` fields."""
        time_s = timestamp_of(job.source.name) if job.source.time_s is None else job.source.time_s
        known = {
            "frame": job.source.frame,
            "timestamp_s": time_s,
            "exposure_s": one.exposure_s,
            "beta": self.common.estimating.beta,
            "max_error_px": self.common.estimating.max_error,
            "seed": self.common.estimating.seed,
            "version": __version__,
            "input_sha256": job.input_sha256,
            "options_sha256": self.key(job),
        }
        return Photograph.of(one.estimate, name=job.name, **known | stated).of_use()


def _settings(options: Any) -> dict[str, Any]:
    """Return the values of a dataclass of options by their names, of groups that have an effect alone."""
    values = {one: getattr(options, one.name) for one in fields(options)}
    return {
        one.name: _settings(value) if is_dataclass(value) else value
        for one, value in values.items()
        if getattr(one.type, "effect", True)
    }


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
def _matched(earlier: Content, later: Content, as_stored: bool) -> tuple[Array, Array]:
    """Return matched pixels of two photographs, which each of them asks for."""
    return match_features(_features(*earlier, as_stored), _features(*later, as_stored))


@lru_cache(maxsize=3)
def _features(source: Source, content: bytes, as_stored: bool) -> Features:
    return features_of(read_image(source.path, as_stored=as_stored, content=content))
