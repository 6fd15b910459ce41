"""Groups of options, of which commands over photographs are composed.

`run.digest_of` lists those on which the result of a photograph depends.
"""

import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from blur2view.camera import Camera, ExifValues
from blur2view.cli.parser import (
    dask_address,
    exposure_s,
    flag,
    focal_px,
    frame_or_seconds,
    option,
    rare_option,
    required,
    seconds,
    whole,
)
from blur2view.colmap.project import camera_of_database, database_named
from blur2view.errors import CameraError
from blur2view.geometry.rolling_shutter import RollingShutter
from blur2view.images.inputs import Inputs, list_photographs
from blur2view.images.video import frame_numbers
from blur2view.smears.matches import SelectOptions
from blur2view.two_view.estimate import EstimatorOptions

STANDARD_OUTPUT = Path("-")  # of --csv


@dataclass(frozen=True, kw_only=True)
class Printing:
    """Printing."""

    either = ("verbose", "quiet")
    verbose: bool = flag("-v, --verbose: also print the reason of each result")
    quiet: bool = flag("-q, --quiet: print failures only")


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Input."""

    images: list[str] = required("""INPUT: photographs, folders of photographs (or, without any, of videos),
        videos and animated GIFs, or lists of them as @LIST, or - from standard input; JPEG, PNG, TIFF, WebP,
        AVIF, JPEG 2000, BMP, GIF, PPM and TGA, of 8
        or 16 bits, with the extras heic and raw also HEIC and RAW. Frames of a video are named VIDEO/000120
        by their number. A list names one of these on each line, as seen from here or else from the list's
        folder (blank lines are passed over, and those that begin with # and name no file). What is named
        twice is done once""")
    recursive: bool = flag("--recursive: folders stand for their subfolders as well")
    every: int = option("--every N: of a video take one frame in N (default: all)", 1)
    first: Annotated[float, frame_or_seconds] = rare_option(
        "--from FRAME: the first frame of a video: a number from 0, or a time as 12.5s", 0
    )
    last: Annotated[float | None, frame_or_seconds] = rare_option("--to FRAME: the last frame, included")

    def inputs(self) -> Inputs:
        """Return the photographs that are named; ImageError if a list cannot be read."""
        frames = partial(frame_numbers, every=self.every, first=self.first, last=self.last)
        stdin = None if sys.stdin is None else sys.stdin.buffer
        return list_photographs(self.images, recursive=self.recursive, frames=frames, stdin=stdin)


@dataclass(frozen=True, kw_only=True)
class CameraStated:
    """Camera.

    Known intrinsics give the essential matrix E and the pose.

    Without these options the focal length of EXIF, where there is one, is a hint, and nothing is called
    calibrated. What is stated here is believed.
    """

    either = ("focal", "camera")
    focal: Annotated[float | None, focal_px] = option("""--focal PX: focal length in pixels; the principal
        point is the photograph's centre""")
    camera: str | None = option("""--camera CAMERA: instead of --focal: a camera as COLMAP writes it, "MODEL
        WIDTH HEIGHT PARAMS...", for example "SIMPLE_RADIAL 640 480 525 320 240 0.05" (any model but
        EQUIRECTANGULAR, one of another size is scaled), a COLMAP database as "project.db" (the camera of the
        image of this name) or "project.db:ID", or "exif" to take the focal length of EXIF for true""")

    def __post_init__(self) -> None:
        if self.focal is not None:
            Camera.from_focal(self.focal, (1, 1))  # which checks it
        if self.camera is not None and self.camera != "exif" and self.database is None:
            Camera.from_string(self.camera)

    @property
    def database(self) -> Path | None:
        """The COLMAP database that has the camera, if one does."""
        stored = database_named(self.camera or "")
        return None if stored is None else stored[0]

    @property
    def given(self) -> bool:
        """Whether there are intrinsics."""
        return self.focal is not None or self.camera is not None

    def camera_of(self, path: Path, image_size: tuple[int, int], exif: ExifValues) -> Camera | None:
        """Return the camera of a photograph of this (width, height), upright, as far as it is stated.

        CameraError if EXIF is asked for and has none, a database cannot be used, or the size does not fit.
        """
        if self.focal is not None:
            return Camera.from_focal(self.focal, image_size)
        if self.camera is None:
            return exif.camera(image_size)
        if self.camera == "exif":
            if (camera := exif.camera(image_size, log_focal_sigma=0.0)) is None:
                raise CameraError(f"{path}: EXIF names no focal length; give it with --focal PX")
            return camera
        stored = database_named(self.camera)
        camera = Camera.from_string(self.camera) if stored is None else camera_of_database(*stored, str(path))
        try:
            return camera.for_image(image_size)
        except CameraError as error:
            raise CameraError(f"{path}: {error}") from None


@dataclass(frozen=True, kw_only=True)
class Order:
    """Time."""

    sequence: bool | None = option("""--sequence: the photographs are a video in this order: those before and
        after each one show which end of its exposure came first, so that rates are one series; with
        --no-sequence not even the frames of a video do (default: those of a video)""")


@dataclass(frozen=True, kw_only=True)
class InTime:
    """Time."""

    exposure: Annotated[float | None, exposure_s] = option("""--exposure S: exposure time in seconds, as 0.04,
        1/25 or 40ms, with --focal or --camera: the angular velocity is the rotation over it (default: that of
        EXIF)""")
    readout: Annotated[float | None, seconds] = rare_option("""--readout S: of a rolling shutter, with --focal
        or --camera: seconds from the start of exposure of the first row to that of the last one; rows are
        those of the file as stored. A point that moves with the rows is seen for longer, so the motion
        differs with the order in time: one is given, of both that which has less parallax, the other is
        backward in the JSON document""")

    def check(self, camera: CameraStated) -> None:
        """Raise ValueError if rates are asked for without intrinsics, or the shutter is too slow."""
        for name in ("exposure", "readout"):
            if getattr(self, name) and not camera.given:
                raise ValueError(f"--{name} is about rates and poses, which need --focal or --camera")
        if self.readout is not None:
            RollingShutter(readout_s=self.readout, exposure_s=self.exposure or 1.0)  # which checks it


@dataclass(frozen=True, kw_only=True)
class Estimating:
    """Estimation.

    A smear is the path of a scene point in the picture while the shutter was open.

    Its two ends are a match whose order in time is unknown.
    """

    beta: float = rare_option(
        """--beta SHARE: share, above 0 and at most 1, of the network's smears (one every 32 pixels) that
        may be used, the most certain ones (default: %(default)s)""",
        SelectOptions.beta,
    )
    max_error: float = rare_option(
        """--max-error PX: largest Sampson distance, in the better order of the ends, of an inlier
        (default: %(default).4g, the square root of the paper's 3 squared pixels)""",
        EstimatorOptions.max_error_px,
    )
    seed: Annotated[int, whole(0)] = rare_option(
        """--seed N: of the random samples, 0 or more; equal seeds give equal results (default:
        %(default)s)""",
        0,
    )
    model: str | None = rare_option("""--model ONNX: a smear network, written by tools/training/export.py
        (default: the shipped one)""")
    provider: str | None = rare_option("""--provider NAME: let ONNX Runtime run the network on cuda, coreml,
        openvino or what else its build has, for example onnxruntime-gpu; results differ by rounding (default:
        the processor)""")

    def __post_init__(self) -> None:
        self.select()
        self.robust()

    def select(self) -> SelectOptions:
        """Return which smears are used; ValueError if the share is not in range."""
        return SelectOptions(beta=self.beta)

    def robust(self) -> EstimatorOptions:
        """Return those of the robust estimator; ValueError if the error is not positive."""
        return EstimatorOptions(max_error_px=self.max_error)


@dataclass(frozen=True, kw_only=True)
class Many:
    """Many photographs."""

    either = ("jobs", "dask")
    jobs: int | None = option("""--jobs N: processes, of one thread each; any number gives the same bytes
        (default: one per core)""")
    dask: Annotated[str | None, dask_address] = rare_option("""--dask ADDRESS: let the workers of a Dask
        cluster do the work, as of: dask scheduler; dask worker tcp://HOST:8786; --dask tcp://HOST:8786.
        Photographs are sent, files are written here; the workers need this blur2view (pip install '.[dask]').
        A scheduler is trusted like a shell: who reaches it can run programs on the workers and here;
        blur2view itself listens nowhere. Not with a database's camera, nor with --link""")


@dataclass(frozen=True, kw_only=True)
class Document:
    """Output."""

    json: bool = flag("--json: print one JSON document instead of the summaries, see below")


@dataclass(frozen=True, kw_only=True)
class Folder:
    """Output."""

    output: Path | None = option("""-o, --output DIR: write files of each photograph, see below, into DIR, in
        place of those of an earlier call""")
    resume: bool = flag("""--resume: with -o: skip photographs whose results in DIR are all there, and of the
        same content, options, network and version; do the others""")

    def __post_init__(self) -> None:
        if self.resume and self.output is None:
            raise ValueError("--resume goes on with results that are kept; name them with -o")


@dataclass(frozen=True, kw_only=True)
class Table:
    """Output."""

    csv: Path | None = option("""--csv FILE: write a table with a row for each photograph, to standard output,
        in place of the summaries, if FILE is -; blur2view triage --help-all names its columns. A table of an
        earlier call is replaced, unless it has changed since""")


@dataclass(frozen=True, kw_only=True)
class Command:
    """The options of any command over photographs."""

    table: Table = Table()
    reading: Reading
    stated_camera: CameraStated = CameraStated()
    estimating: Estimating = Estimating()
    many: Many = Many()
    printing: Printing = Printing()

    order, in_time = Order(sequence=False), InTime()  # unless a command has these options
    folder, document = Folder(), Document()  # likewise
    exit_codes = {
        "0": "done",
        "1": "a photograph failed, with one line on stderr each; others are done all the same",
        "130": "interrupted by Ctrl-C; files of photographs that are done are kept",
    }
    as_stored = False  # whether photographs are taken as they are stored, not upright

    def __post_init__(self) -> None:
        if self.document.json and self.table.csv == STANDARD_OUTPUT:
            raise ValueError("--json and --csv - both print to standard output; name a file with --csv")
        if self.many.dask is not None and self.stated_camera.database is not None:
            raise ValueError("the workers of --dask see no database; write its camera out")
        self.in_time.check(self.stated_camera)

    @property
    def silent(self) -> bool:
        """Whether no summaries are printed, as asked, or because a document or a table is."""
        return self.printing.quiet or self.document.json or self.table.csv == STANDARD_OUTPUT
