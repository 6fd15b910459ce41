"""The options that the commands over photographs share."""

import os
import sys
from dataclasses import MISSING, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from blur2view.camera.intrinsics import Intrinsics
from blur2view.cli.arguments import values
from blur2view.cli.arguments.option import CAMERA, ESTIMATION, INPUT, MANY, Options, option
from blur2view.colmap.cameras import stored_camera
from blur2view.geometry.rolling_shutter import RollingShutter
from blur2view.images.inputs import Inputs, list_photographs
from blur2view.images.video import frame_numbers
from blur2view.input_files import MAX_MEMORY_GIB
from blur2view.networks.model_file import model_path
from blur2view.pipeline import Run
from blur2view.runs.job import Job, Outcome, file_digest
from blur2view.runs.manifest import ENDING
from blur2view.smears.selection import SelectOptions
from blur2view.two_view.options import EstimatorOptions


@dataclass(frozen=True, kw_only=True)
class PhotographOptions(Options):
    """The options of all commands that estimate, which go to the processes that do the work.

    ``inputs`` are the photographs, which stay here; ``run`` is how each is estimated, ``digest`` the SHA-256
    of the network's file.
    """

    keeps: ClassVar[bool] = True  # whether what is made of each photograph is needed at the end

    run: Run = field(init=False)
    inputs: Inputs = field(init=False)
    digest: str = field(init=False)

    images: list[str] = option(MISSING, "INPUT", group=INPUT)
    """photographs, folders of photographs, videos, or lists of them as @LIST, or - from standard input; JPEG,
    PNG, TIFF, WebP, AVIF, JPEG 2000, BMP, GIF, PPM and TGA, of 8 or 16 bits, with the extras heic and raw
    also HEIC and RAW. Frames of a video are named VIDEO/000120 by their number. A list names one of these on
    each line, as seen from here or else from the list's folder (blank lines are passed over, and those that
    begin with # and name no file). What is named twice is done once"""
    recursive: bool = option(False, group=INPUT)
    "folders stand for their subfolders, too"
    every: int = option(1, "N", group=INPUT)
    "of a video take one frame in N (default: all)"
    first: float = option(0, "FRAME", group=INPUT, names="--from", convert=values.frame_or_seconds, rare=True)
    "the first frame of a video: a number from 0, or a time as 12.5s"
    last: float | None = option(
        None, "FRAME", group=INPUT, names="--to", convert=values.frame_or_seconds, rare=True
    )
    "the last frame, included"

    sequence: bool | None = option(None)
    """the photographs are a video in this order: those before and after each one show which end of its
    exposure came first, so that rates are one series; with --no-sequence not even the frames of a video do
    (default: those of a video)"""
    timestamps: Path | None = option(None, "TABLE", rare=True)
    """times of the photographs: a table that names each in one column and has its time in another, as
    EuRoC's data.csv and TUM's rgb.txt (default: a name that is a time, as 1403636579.763.png)"""
    timings: bool = option(True, rare=True, result=True)
    "without timings: equal calls give equal bytes"
    csv: Path | None = option(None, "FILE")
    "write a table with a row for each photograph; blur2view triage --help-all names its columns"
    json: bool = False
    jsonl: bool = False
    overwrite: bool = False

    jobs: int | None = option(None, "N", group=MANY, either="processes")
    "processes, of one thread each; any number gives the same bytes (default: one per core)"
    dask: str | None = option(None, "ADDRESS", group=MANY, either="processes", rare=True)
    """let the workers of a Dask cluster do the work, as of: dask scheduler; dask worker tcp://HOST:8786;
    --dask tcp://HOST:8786. Photographs are sent, files are written here; the workers need this blur2view (pip
    install '.[dask]'). A scheduler is trusted like a shell: who reaches it can run programs on the workers
    and here; blur2view itself listens nowhere. Not with a database's camera, nor with --link"""
    resume: bool = option(False, group=MANY)
    """go on: skip photographs that an earlier call has done with the same content, network and options, whose
    results are whole; do the others, also over their earlier results"""
    max_failures: int | None = option(None, "N", group=MANY, rare=True)
    "stop when as many photographs have failed"

    focal: float | None = option(None, "PX", group=CAMERA, convert=values.pixels, result=True)
    "focal length in pixels; the principal point is the photograph's centre"
    camera: str | None = option(None, "CAMERA", group=CAMERA, result=True)
    """instead of --focal: a camera as COLMAP writes it, "MODEL WIDTH HEIGHT PARAMS...", for example
    "SIMPLE_RADIAL 640 480 525 320 240 0.05" (any model but EQUIRECTANGULAR, one of another size is scaled), a
    COLMAP database as "project.db" (the camera of the image of this name) or "project.db:ID", or "exif" to
    take the focal length of EXIF for true"""
    exposure: float | None = option(None, "S", group=CAMERA, convert=values.exposure, result=True)
    """exposure time in seconds, as 0.04, 1/25 or 40ms, with --focal or --camera: the angular velocity is the
    rotation over it (default: that of EXIF)"""
    readout: float | None = option(None, "S", group=CAMERA, convert=values.seconds, rare=True, result=True)
    """of a rolling shutter, with --focal or --camera: seconds from the start of exposure of the first row to
    that of the last one; rows are those of the file as stored. A point that moves with the rows is seen for
    longer, so the motion differs with the order in time: one is given, of both that which has less parallax,
    the other is backward in the JSON document"""

    gyroscope: bool = option(False, group=CAMERA, rare=True, result=True)
    """with --focal or --camera: give rates the sign that a gyroscope along the camera's axes shows, which is
    the negative of the scene's"""

    beta: float = option(
        SelectOptions.beta,
        "SHARE",
        group=ESTIMATION,
        rare=True,
        max_matches=SelectOptions.max_matches,
        result=True,
    )
    """share, above 0 and at most 1, of the network's smears (one every 32 pixels) that may be used, the most
    certain ones; at most %(max_matches)s of them, spread evenly, are (default: %(default)s)"""
    max_error: float = option(EstimatorOptions.max_error_px, "PX", group=ESTIMATION, rare=True, result=True)
    """a smear is an inlier if the Sampson distance of its ends from the epipolar geometry, in the better of
    both orders, is below a tenth of its length and below this many pixels, or below two of its own
    standard deviations (default: %(default).4g, the square root of the paper's 3 squared pixels)"""
    seed: int = option(0, "N", group=ESTIMATION, convert=values.whole(0), rare=True, result=True)
    "of the random samples, 0 or more; equal seeds give equal results (default: %(default)s)"
    max_memory: float = option(MAX_MEMORY_GIB, "GIB", group=ESTIMATION, rare=True)
    """refuse photographs whose estimate takes more memory of its process, of which --jobs starts many; masks
    take up to half as much again (default: %(default)s, enough for 32 megapixels, with masks for 24)"""
    model: str | None = option(None, "ONNX", group=ESTIMATION, rare=True)
    "a smear network, written by tools/training/export_reader.py (default: the shipped one)"
    provider: str | None = option(None, "NAME", group=ESTIMATION, rare=True, result=True)
    """let ONNX Runtime run the network on cuda, coreml, openvino or what else its build has, for example
    onnxruntime-gpu; results differ by rounding (default: the processor)"""

    def __post_init__(self) -> None:
        frames = partial(frame_numbers, every=self.every, first=self.first, last=self.last)
        stdin, model = None if sys.stdin is None else sys.stdin.buffer, model_path(self.model)
        inputs = list_photographs(self.images, recursive=self.recursive, frames=frames, stdin=stdin)
        digest = file_digest(model) if model.is_file() else ""
        for name, value in (("run", self._run()), ("inputs", inputs), ("digest", digest)):
            object.__setattr__(self, name, value)
        if self.dask is not None and callable(self.run.intrinsics.camera):
            raise ValueError("the workers of --dask see no database; write its camera out")

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"images": [], "inputs": None}

    def __call__(self, job: Job) -> Outcome:
        """Return what is made of one photograph, in whichever process; Blur2ViewError where it fails."""
        raise NotImplementedError

    @property
    def targets(self) -> dict[str, Path]:
        """The files of all photographs that the call writes, by their options."""
        return {} if self.csv is None else {"--csv": self.csv}

    @property
    def manifest_path(self) -> Path | None:
        """The hidden manifest of the first of them; one photograph alone leaves nothing to go on with."""
        target = next(iter(self.targets.values()), None)
        if target is None or (len(self.inputs.paths) == 1 and not self.resume):
            return None
        target = Path(os.path.abspath(target))  # . has no name
        return target.with_name(f".{target.name}{ENDING}")

    @property
    def prints(self) -> bool:
        """Whether a line is printed for each photograph, and a total."""
        return not self.json and not self.jsonl and not self.quiet

    def _run(self) -> Run:
        """Return how each photograph is estimated; ValueError of what does not go together."""
        if self.focal is None and self.camera is None:
            for name in ("exposure", "readout", "gyroscope"):
                if getattr(self, name):
                    raise ValueError(f"--{name} is about rates and poses, which need --focal or --camera")
        if self.readout is not None:
            RollingShutter(readout_s=self.readout, exposure_s=self.exposure or 1.0)  # which checks it
        camera = stored_camera(self.camera or "") or self.camera
        return Run(
            select=SelectOptions(beta=self.beta),
            options=EstimatorOptions(max_error_px=self.max_error),
            seed=self.seed,
            intrinsics=Intrinsics(focal_px=self.focal, camera=camera),
            exposure_s=self.exposure,
            readout_s=self.readout,
            max_memory_gib=self.max_memory,
            gyroscope=self.gyroscope,
        )
