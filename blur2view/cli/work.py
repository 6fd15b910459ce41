"""The work on one photograph, as far as the commands share it: how it is estimated, by which network."""

import hashlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache
from multiprocessing import parent_process
from pathlib import Path
from typing import Any

import numpy as np

from blur2view import __version__
from blur2view.arrays import AnyArray
from blur2view.camera import Camera, ExifValues, read_exif
from blur2view.cli.options import Command
from blur2view.errors import Blur2ViewError, CameraError
from blur2view.exposure.sequence import Features, Matches, features_of, in_time, match_features
from blur2view.geometry.rolling_shutter import RollingShutter
from blur2view.images.image import read_image, read_pixels
from blur2view.images.inputs import Source, timestamp_of
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


def digest_of(options: Command) -> str:
    """Return the SHA-256 of all that results depend on besides photographs: options, network, version.

    Those are the groups of the camera, of the estimate and of time, and a command's own but for paths.
    """
    common = options.common
    files = model_path(common.estimating.model), common.lens.database
    digests = [file_digest(one) if one is not None and one.is_file() else "" for one in files]
    values = {one.name: getattr(options, one.name) for one in fields(options) if one.type != Path | None}
    own = {name: one for name, one in values.items() if not isinstance(one, Path) and not is_dataclass(one)}
    groups = common.lens, common.estimating, options.timing
    every = type(options).__name__, __version__, digests, groups, own
    return hashlib.sha256(repr(every).encode()).hexdigest()


def network_of(options: Command) -> SmearNetwork:
    """Return the smear network of this process, loaded once; ModelError if it cannot be used."""
    return _network(options.common.estimating.model, options.common.estimating.provider)


@lru_cache(maxsize=1)
def _network(model: str | None, provider: str | None) -> SmearNetwork:
    threads = usable_cores() if parent_process() is None else 1  # on which bytes do not depend
    return SmearNetwork(model, threads=threads, providers=() if provider is None else (provider,))


def estimated(
    options: Command,
    job: Job,
    *,
    as_stored: bool = False,
    camera_of: CameraOf | None = None,
    detail: Detail = Detail.GEOMETRY,
) -> Estimated:
    """Return the estimate of a photograph, in the order in time that its neighbours decide.

    Each has a generator of its own, so that its result does not depend on those before it. ``as_stored`` is
    as of `read_image`, ``detail`` of `estimate`; ``camera_of`` gives intrinsics, by default those of options
    or EXIF. ImageError, CameraError or ModelError if one cannot be used.
    """
    path, timing = Path(str(job.source)), options.timing
    image = read_pixels(path, as_stored=as_stored, content=job.content)
    exif = read_exif(path, job.content)
    exposure_s = timing.exposure or exif.exposure_s
    found = estimate(
        image,
        network=network_of(options),
        select=options.common.estimating.select(),
        options=options.common.estimating.robust(),
        rng=np.random.default_rng(options.common.estimating.seed),
        camera=(camera_of or options.common.lens.camera_of)(path, image.shape[1::-1], exif),
        shutter=_shutter(job.source, timing.readout, exposure_s, exif),
        detail=detail,
    )
    return Estimated(estimate=_in_time(found, job, as_stored), image=image, exposure_s=exposure_s)


def _shutter(
    source: Source, readout_s: float | None, exposure_s: float | None, exif: ExifValues
) -> RollingShutter | None:
    """Return the rolling shutter of a photograph, None where the options name none."""
    if not readout_s:
        return None
    if exposure_s is None:
        raise CameraError(f"{source}: --readout needs the exposure time, EXIF names none; add --exposure S")
    towards = exif.rows_towards if source.frame is None else rows_towards(source.path)
    return RollingShutter(readout_s=readout_s, exposure_s=exposure_s, towards=towards)


def _in_time(found: Estimate, job: Job, as_stored: bool) -> Estimate:
    """Return an estimate in the order that the photographs before and after it decide."""
    matches, here = dict[int, Matches](), (job.source, job.content)
    for steps, near in job.neighbours:
        if near not in job.contents:  # it cannot be read, and has a line of its own
            continue
        with suppress(Blur2ViewError):  # likewise
            there = near, job.contents[near]
            pair = (there, here) if steps < 0 else (here, there)
            earlier, later = _matched(*pair, as_stored)
            matches[steps] = (later, earlier) if steps < 0 else (earlier, later)
    return in_time(found, matches) if job.neighbours else found


def record_of(options: Command, one: Estimated, job: Job, **stated: Any) -> Photograph:
    """Return the record of an estimate, with ``stated`` fields."""
    source = job.source
    return Photograph.of(
        one.estimate,
        name=job.name,
        frame=source.frame,
        exposure_s=one.exposure_s,
        beta=options.common.estimating.beta,
        max_error_px=options.common.estimating.max_error,
        seed=options.common.estimating.seed,
        version=__version__,
        input_sha256=job.input_sha256,
        options_sha256=job.options_sha256,
        **{"timestamp_s": timestamp_of(source.name) if source.time_s is None else source.time_s} | stated,
    ).of_use()


@lru_cache(maxsize=2)
def _matched(earlier: Content, later: Content, as_stored: bool) -> Matches:
    """Return matched pixels of two photographs, which each of them asks for."""
    return match_features(_features(*earlier, as_stored), _features(*later, as_stored))


@lru_cache(maxsize=3)
def _features(source: Source, content: bytes, as_stored: bool) -> Features:
    return features_of(read_image(source.path, as_stored=as_stored, content=content))
