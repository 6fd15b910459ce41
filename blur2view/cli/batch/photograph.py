"""The photograph of a job, read and estimated as the options of its command say."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from blur2view import __version__
from blur2view.arrays import AnyArray
from blur2view.camera import Camera
from blur2view.cli.batch.job import Job
from blur2view.cli.options import Command, Estimating
from blur2view.errors import CameraError
from blur2view.exposure.sequence import Features, extract_features, in_time
from blur2view.geometry.rolling_shutter import RollingShutter
from blur2view.images.exif import ExifValues
from blur2view.images.image import Content, Picture, read_image, read_picture
from blur2view.images.inputs import Source
from blur2view.images.times import timestamp_of
from blur2view.images.video import rows_towards
from blur2view.movers.mask import MotionMask
from blur2view.networks.model_file import usable_cores
from blur2view.networks.smear_network import Detail, SmearNetwork
from blur2view.pipeline import Estimate, estimate
from blur2view.processes import is_child
from blur2view.records.record import Record

FindCamera = Callable[[Path, tuple[int, int], ExifValues], Camera | None]  # path, width and height, EXIF


@lru_cache(maxsize=1)
def open_network(estimating: Estimating) -> SmearNetwork:
    """Return the smear network of this process, loaded once; ModelError if it cannot be used."""
    threads = 1 if is_child() else usable_cores()  # on which bytes do not depend
    providers = () if estimating.provider is None else (estimating.provider,)
    return SmearNetwork(estimating.model, threads=threads, providers=providers)


@dataclass(frozen=True, kw_only=True, eq=False)
class EstimatedFile:
    """The estimate of a photograph's file, its picture, and what options and file add to its record."""

    estimate: Estimate
    picture: Picture  # upright unless wanted as stored
    stated: Mapping[str, Any]

    @property
    def image(self) -> AnyArray:
        """The picture's pixels (H, W, 3)."""
        return self.picture.pixels

    def record(self, mask: MotionMask | None = None, threshold: float | None = None) -> Record:
        """Return the record of the photograph, and of what moves in it, if that was asked, by a threshold."""
        return self.estimate.record(mask=mask, threshold=threshold, **self.stated).with_use()


def estimate_file(
    options: Command,
    job: Job,
    *,
    find_camera: FindCamera | None = None,
    detail: Detail = Detail.GEOMETRY,
    geometry: bool = True,
    closer: bool = True,
) -> EstimatedFile:
    """Return the estimate of a photograph, in the order in time that its neighbours decide.

    The generator of random numbers starts anew, so that a result does not depend on photographs before it.
    ``detail``, ``geometry`` and ``closer`` are those of `estimate`; ``find_camera`` gives intrinsics, by
    default those of options or EXIF. ImageError, CameraError or ModelError if one cannot be used.
    """
    source, path, estimating = job.source, Path(str(job.source)), options.estimating
    picture = read_picture(path, as_stored=options.as_stored, content=job.content)
    exif = picture.exif
    exposure_s = options.in_time.exposure or exif.exposure_s
    result = estimate(
        picture.pixels,
        network=open_network(estimating),
        select=estimating.select(),
        options=estimating.robust(),
        rng=np.random.default_rng(estimating.seed),
        camera=(find_camera or options.stated_camera.camera_for)(path, picture.size, exif),
        shutter=_shutter(source, options.in_time.readout, exposure_s, exif),
        detail=detail,
        geometry=geometry,
        closer=closer,
    )
    record_fields = {
        "name": job.name,
        "frame": source.frame,
        "timestamp_s": timestamp_of(source.name) if source.time_s is None else source.time_s,
        "exposure_s": exposure_s,
        "beta": estimating.beta,
        "max_error_px": estimating.max_error,
        "seed": estimating.seed,
        "version": __version__,
        "input_sha256": job.input_sha256,
        "options_sha256": job.job_sha256,
    }
    if job.neighbours:
        result = in_time(result, job.matches)
    return EstimatedFile(estimate=result, picture=picture, stated=record_fields)


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


def features_in(as_stored: bool, source: Source, content: Content) -> Features:
    """Return the features of a photograph, by which its neighbours are matched."""
    return extract_features(read_image(source.path, as_stored=as_stored, content=content))
