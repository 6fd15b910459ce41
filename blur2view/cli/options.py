"""Groups of options that the commands over photographs share.

`batch.run.options_digest` lists those on which the result of a photograph depends.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar

from blur2view.camera import CAMERA_FORM, Camera
from blur2view.cli.parser import (
    dask_address,
    exposure_s,
    file_path,
    flag,
    focal_px,
    frame_or_seconds,
    option,
    rare_option,
    required,
    seconds,
    whole,
)
from blur2view.colmap.project import camera_of_database, check_cameras, database_named
from blur2view.errors import CameraError
from blur2view.geometry.rolling_shutter import RollingShutter
from blur2view.images.exif import ExifValues
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

    images: list[str] = required("""INPUT: photographs, folders, videos and animated GIFs, lists of them
        (@LIST), or - for a list from standard input; a folder stands for the photographs in it or, if it has
        none, for its videos. Photographs are JPEG, PNG, TIFF, WebP, AVIF, JPEG 2000, BMP, GIF, PPM or TGA
        files of 8 or 16 bits, and with the extras heic and raw also HEIC and RAW files. A file of 16 bits
        whose values have 8 is read as 8 bits, unless another one in its folder has higher values.
        VIDEO/000120 names one frame of a video by its number. A list has one name on each line, relative to
        the current folder or else to the folder of the list; blank lines are skipped, and so are lines that
        begin with # unless there is a file of that name. A photograph that is named twice is processed
        once""")
    recursive: bool = flag("--recursive: also read the subfolders of folders")
    every: int = option("--every N: take one frame in N of a video (default: all)", 1)
    first: Annotated[float, frame_or_seconds] = rare_option(
        "--from FRAME: first frame to take of a video: a number, counted from 0, or a time such as 12.5s", 0
    )
    last: Annotated[float | None, frame_or_seconds] = rare_option(
        "--to FRAME: last frame to take of a video, a number or a time"
    )

    def __post_init__(self) -> None:
        if type(self.first) is type(self.last) and self.first > (self.last or 0):
            unit = "s" if isinstance(self.first, float) else ""
            raise ValueError(f"--from {self.first:g}{unit} comes after --to {self.last:g}{unit}; swap them")

    def inputs(self) -> Inputs:
        """Return the photographs that are named; ImageError if a list cannot be read."""
        frames = partial(frame_numbers, every=self.every, first=self.first, last=self.last)
        stdin = None if sys.stdin is None else sys.stdin.buffer
        return list_photographs(self.images, recursive=self.recursive, frames=frames, stdin=stdin)


@dataclass(frozen=True, kw_only=True)
class CameraStated:
    """Camera.

    Known intrinsics give the essential matrix E and the pose.

    Without these options the focal length that EXIF states is only a hint, and the geometry stays
    uncalibrated. A camera that is given here is taken as exact.
    """

    either = ("focal", "camera")
    focal: Annotated[float | None, focal_px] = option("""--focal PX: focal length in pixels; the principal
        point is the photograph's centre""")
    camera: str | None = option("""--camera CAMERA: camera in COLMAP's form "MODEL WIDTH HEIGHT PARAMS...",
        for example "SIMPLE_RADIAL 640 480 525 320 240 0.05", or a COLMAP database, or "exif"; it takes the
        place of --focal. Any model but EQUIRECTANGULAR will do, and a camera of another size is scaled.
        "project.db" takes the camera of the image with the photograph's name, "project.db:ID" the camera with
        this number, and "exif" takes the focal length of EXIF as exact""")

    def __post_init__(self) -> None:
        if self.focal is not None:
            Camera.from_focal(self.focal, (1, 1))  # which checks it
        if self.camera is not None and self.camera != "exif":
            self._check(self.camera)

    def _check(self, camera: str) -> None:
        """Raise CameraError, before any photograph is read, if a string or a database has no such camera."""
        if (location := database_named(camera)) is None:
            if len(camera.replace(",", " ").split()) == 1:
                why = f"is neither exif, nor a database that is there, nor {CAMERA_FORM}"
                raise CameraError(f"camera {camera!r}: {why}")
            Camera.from_string(camera)
        elif location[1] is not None:
            camera_of_database(*location)
        else:
            check_cameras(location[0])

    @property
    def database(self) -> Path | None:
        """The COLMAP database that has the camera, if one does."""
        location = database_named(self.camera or "")
        return None if location is None else location[0]

    @property
    def given(self) -> bool:
        """Whether there are intrinsics."""
        return self.focal is not None or self.camera is not None

    def camera_for(self, path: Path, image_size: tuple[int, int], exif: ExifValues) -> Camera | None:
        """Return the camera of a photograph of this (width, height), upright, as far as it is stated.

        Raises CameraError if EXIF has to state the focal length and does not, if a database cannot be used,
        or if the size does not fit.
        """
        if self.focal is not None:
            return Camera.from_focal(self.focal, image_size)
        if self.camera is None:
            return exif.camera(image_size)
        if self.camera == "exif":
            if (camera := exif.camera(image_size, log_focal_sigma=0.0)) is None:
                raise CameraError(f"{path}: EXIF states no focal length; give it with --focal PX")
            return camera
        location = database_named(self.camera)
        camera = (
            Camera.from_string(self.camera) if location is None else camera_of_database(*location, str(path))
        )
        try:
            return camera.for_image(image_size)
        except CameraError as error:
            raise CameraError(f"{path}: {error}") from None


@dataclass(frozen=True, kw_only=True)
class Order:
    """Time."""

    sequence: bool | None = option("""--sequence: treat the photographs as the frames of one video, in this
        order; the frames before and after each one then show which end of its exposure came first, so that
        the rates form one series. With --no-sequence each frame of a video is estimated by itself (default:
        frames of a video are a sequence, photographs are not)""")


@dataclass(frozen=True, kw_only=True)
class InTime:
    """Time."""

    exposure: Annotated[float | None, exposure_s] = option("""--exposure S: exposure time in seconds, such as
        0.04, 1/25 or 40ms; with --focal or --camera it turns the rotation into an angular velocity (default:
        the exposure time of EXIF)""")
    readout: Annotated[float | None, seconds] = rare_option("""--readout S: readout time of a rolling shutter
        in seconds, from the start of exposure of the first row to that of the last one; it needs --focal or
        --camera. Rows are those of the file as it is stored. A rolling shutter sees a point for longer if the
        point moves in the direction of the readout, so that the two orders in time give two geometries. The
        one with less parallax is printed, and the other one is "backward" in the JSON document""")

    def check(self, camera: CameraStated) -> None:
        """Raise ValueError if rates are requested without intrinsics, or if the shutter is too slow."""
        for name in ("exposure", "readout"):
            if getattr(self, name) and not camera.given:
                raise ValueError(f"--{name} needs the focal length; add --focal PX or --camera")
        if self.readout is not None:
            RollingShutter(readout_s=self.readout, exposure_s=self.exposure or 1.0)  # which checks it


@dataclass(frozen=True, kw_only=True)
class Estimating:
    """Estimation.

    A smear is the path of a scene point in the picture while the shutter was open.

    Its two ends are a match whose order in time is unknown.
    """

    beta: float = rare_option(
        """--beta SHARE: share of the network's smears that the estimator uses, the most certain ones first,
        above 0 and at most 1; the network reads a smear every 32 pixels,
        of more than 2.5 megapixels fewer (default: %(default)s)""",
        SelectOptions.beta,
    )
    max_error: float = rare_option(
        """--max-error PX: largest Sampson distance of an inlier, with its ends in the better order (default:
        %(default).4g, the square root of the paper's 3 squared pixels)""",
        EstimatorOptions.max_error_px,
    )
    seed: Annotated[int, whole(0)] = rare_option(
        """--seed N: seed of the random samples, 0 or more; equal seeds give equal results (default:
        %(default)s)""",
        0,
    )
    model: str | None = rare_option("""--model ONNX: smear network to use, as tools/training/export.py writes
        it (default: the one that comes with blur2view)""")
    provider: str | None = rare_option("""--provider NAME: run the network on cuda, coreml, openvino or
        another provider of the installed ONNX Runtime; onnxruntime-gpu, for example, has cuda. Results differ
        by rounding (default: the processor)""")

    def __post_init__(self) -> None:
        self.select()
        self.robust()

    def select(self) -> SelectOptions:
        """Return which smears are used; raises ValueError if the share is out of range."""
        return SelectOptions(beta=self.beta)

    def robust(self) -> EstimatorOptions:
        """Return the options of the robust estimator; raises ValueError if the error is not positive."""
        return EstimatorOptions(max_error_px=self.max_error)


@dataclass(frozen=True, kw_only=True)
class Many:
    """Many photographs."""

    either = ("jobs", "dask")
    jobs: int | None = option("""--jobs N: number of processes, each with one thread; the results do not
        depend on it (default: one per core)""")
    dask: Annotated[str | None, dask_address] = rare_option("""--dask ADDRESS: let the workers of a Dask
        cluster do the work, for example --dask tcp://HOST:8786 after "dask scheduler" on HOST and "dask
        worker tcp://HOST:8786" on every machine; photographs are sent to the workers, and all files are
        written here. The workers need the same blur2view (pip install '.[dask]'). Use only a cluster that you
        trust: everyone who can reach its scheduler can run programs on the workers and on this machine.
        blur2view itself opens no port. It excludes a camera from a database, and --link""")


@dataclass(frozen=True, kw_only=True)
class Document:
    """Output."""

    json: bool = flag("--json: print one JSON document instead of the summaries")


@dataclass(frozen=True, kw_only=True)
class Folder:
    """Output."""

    output: Path | None = option("""-o, --output DIR: write the files of each photograph into DIR; they
        replace those of an earlier call""")
    resume: bool = flag("""--resume: skip photographs that an earlier call has finished; their results in DIR
        must be complete, and of the same content, options, network and version. It needs -o""")

    def __post_init__(self) -> None:
        if self.resume and self.output is None:
            raise ValueError("--resume needs a folder of results; name it with -o")


@dataclass(frozen=True, kw_only=True)
class Table:
    """Output."""

    csv: Annotated[Path | None, file_path] = (
        option("""--csv FILE: write a table with a row for each photograph; - writes it to
        standard output in place of the summaries. "blur2view triage --help-all" names its columns. The table
        of an earlier call is replaced, unless you have changed it""")
    )


@dataclass(frozen=True, kw_only=True)
class Command:
    """The options that every command over photographs has."""

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
        "1": "at least one photograph failed; each has a line on stderr, but frames of a video that fail for "
        "one reason, which share one; the results of all others are written. Or the call could not begin, or "
        "not go on, as on a full disk; the last line says why",
        "130": "interrupted by Ctrl-C; the files of photographs that are done are kept",
    }
    columns: ClassVar[Sequence[str] | None] = None  # of --csv: all
    as_stored = False  # whether photographs are taken as they are stored, not upright

    def __post_init__(self) -> None:
        if self.document.json and self.table.csv == STANDARD_OUTPUT:
            raise ValueError("--json and --csv - both write to standard output; name a file with --csv")
        if self.many.dask is not None and self.stated_camera.database is not None:
            raise ValueError(
                "the workers of --dask cannot read a database; write the camera out with --camera"
            )
        self.in_time.check(self.stated_camera)

    @property
    def silent(self) -> bool:
        """Whether summaries are left out, because of --quiet, or because a document or a table is printed."""
        return self.printing.quiet or self.document.json or self.table.csv == STANDARD_OUTPUT
