"""``blur2view reconstruct``: from a blurred video to a scene, whose every frame has a pose."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Annotated

from blur2view.cli.options import Printing
from blur2view.cli.parser import OneOf, exposure_s, flag, option, rare_option, required, whole
from blur2view.cli.terminal import INTERRUPTED, complain, plural, printable, waiting
from blur2view.errors import RunError
from blur2view.reconstruction.options import (
    CAMERA_MODELS,
    DIALECTS,
    MAPPERS,
    MIN_FRAMES,
    ReconstructionOptions,
)

if TYPE_CHECKING:
    from blur2view.reconstruction.outcome import Reconstruction

DEFAULT = ReconstructionOptions()
SHOWN = 3  # frames of each reason without -v
WRITTEN = """
images: the chosen frames, or with --all-frames every frame; white space in a name becomes _
sparse/0: COLMAP's model; each of its images is a file in images
masks: masks of what moves by itself, if anything does; they are 0 there. NAME.jpg.png is for COLMAP and
    transforms.json, NAME.png for nerfstudio's reader of COLMAP's models, and images/dynamic_mask_NAME.png for
    instant-ngp
exposures: the same model, with the views NAME#open and NAME#close of each recovered frame
database.db: COLMAP's features and matches
transforms.json: the scene for nerfstudio and its fork for motion blur, with its points in sparse_pc.ply, or
    for instant-ngp
report.html: the video's blur over time, the camera's path, and the frames
reconstruction.json, work: what is done so far; if a call was ended, the same call goes on from there
"""
REMEDIES = {
    "too few of": "it shows little of what its neighbours show; add --all-frames for nearer neighbours",
    "fewer than two": "it is far from all registered frames; add --all-frames for nearer neighbours",
    "its pose": "look at it in the report; add --all-frames for nearer neighbours",
}


@dataclass(frozen=True, kw_only=True)
class ReconstructOptions:
    """The options of ``blur2view reconstruct``.

    Make a scene of a video, or of a folder of its frames. COLMAP maps the sharpest frames, blur2view recovers
    those that COLMAP refuses, and the scene is written for trainers of radiance fields. If a call was ended,
    the same call goes on from there.
    """

    video: Path = required("VIDEO: a video, or a folder with the frames of one video")
    output: Path = required(
        "-o, --output DIR: folder for the scene; it is new or empty, or holds the scene of an earlier call"
    )
    frames: Annotated[int, whole(MIN_FRAMES)] = option(
        "--frames N: choose at most N frames, the sharpest ones along the camera's path (default: "
        "%(default)s)",
        DEFAULT.frames,
    )
    all_frames: bool = flag("--all-frames: also recover and keep the frames that are not chosen")
    camera: str = option(
        """--camera CAMERA: known camera in COLMAP's form "MODEL WIDTH HEIGHT PARAMS...", for example
        "SIMPLE_RADIAL 640 480 525 320 240 0.05"; it is scaled to the frames' size, and COLMAP does not change
        it (default: COLMAP finds the camera, and begins with the focal length of EXIF if there is one)""",
        DEFAULT.camera,
    )
    camera_model: Annotated[str, OneOf(*CAMERA_MODELS)] = option(
        """--camera-model MODEL: camera model that COLMAP fits, SIMPLE_RADIAL, SIMPLE_PINHOLE, PINHOLE, RADIAL
        or OPENCV (default: %(default)s); fisheye lenses are not supported""",
        DEFAULT.camera_model,
    )
    mapper: Annotated[str, OneOf(*MAPPERS)] = rare_option(
        "--mapper NAME: mapper of COLMAP, incremental or global (default: %(default)s)", DEFAULT.mapper
    )
    dialect: Annotated[str, OneOf(*DIALECTS)] = option(
        "--dialect NAME: trainer for which transforms.json is written, nerfstudio or instant-ngp (default: "
        "%(default)s)",
        DEFAULT.dialect,
    )
    exposure: Annotated[float, exposure_s] = rare_option(
        """--exposure S: exposure time in seconds; it scales nerfstudio's velocities (default:
        %(default)g)""",
        DEFAULT.exposure_s,
    )
    masks: bool = option("--no-masks: write no masks of what moves by itself, which is faster", DEFAULT.masks)
    jobs: int | None = option("--jobs N: number of processes that recover frames (default: one per core)")
    printing: Printing = Printing()

    examples = (
        "blur2view reconstruct clip.mp4 -o scene",
        "blur2view reconstruct frames -o scene --all-frames --dialect instant-ngp",
    )
    tables = {"what is written": WRITTEN}
    exit_codes = {
        "1": "failed, or COLMAP made no model; stderr has the cause",
        "130": "interrupted by Ctrl-C; the same call goes on",
    }

    def __post_init__(self) -> None:
        self.scene_options()  # which checks them

    def scene_options(self) -> ReconstructionOptions:
        """Return what the scene is made by; ValueError or CameraError of what cannot be used."""
        return ReconstructionOptions(
            frames=self.frames,
            all_frames=self.all_frames,
            camera_model=self.camera_model,
            camera=self.camera,
            mapper=self.mapper,
            dialect=self.dialect,
            exposure_s=self.exposure,
            masks=self.masks,
        )

    def execute(self) -> int:
        """Return the exit code, after making the scene."""
        import pycolmap

        from blur2view.reconstruction.reconstruct import reconstruct

        pycolmap.logging.minloglevel = pycolmap.logging.Level.ERROR.value
        step = partial(waiting, hidden=self.printing.quiet)
        try:
            made = reconstruct(self.video, self.output, self.scene_options(), jobs=self.jobs, step=step)
        except KeyboardInterrupt:
            complain(RunError("interrupted; the same call goes on"))
            return INTERRUPTED
        if not self.printing.quiet:
            print("\n".join(outcome_table(made, verbose=self.printing.verbose)))
        return 0


def outcome_table(made: "Reconstruction", *, verbose: bool = False) -> Iterator[str]:
    """Yield the lines that tell what became of the frames of a video."""
    posed = [*made.registered, *made.recovered]
    rows = {
        "frames looked at": made.looked_at,
        "chosen, the sharpest": made.chosen,
        "given to COLMAP": made.mapped,
        "registered by COLMAP": made.registered,
        "recovered by their blur": made.recovered,
        "refused": tuple(made.refused),
    }
    for words, names in rows.items():
        smears = made.smears_px(names)
        smeared = f"  {len(smears)} with smears, {median(smears):.1f} px in the median" if smears else ""
        yield f"{words + ':':<26}{len(names):>6}{smeared}"
    for why, count in Counter(made.refused.values()).items():
        these = [name for name, reason in made.refused.items() if reason == why]
        listed = ", ".join(map(printable, these if verbose else these[:SHOWN]))
        more = "" if verbose or count <= SHOWN else f" and {count - SHOWN} more (-v)"
        remedy = next((f"; {text}" for start, text in REMEDIES.items() if why.startswith(start)), "")
        yield f"  refused, {printable(why)}: {listed}{more}{remedy}"
    if made.other_models:
        others = ", ".join(map(str, made.other_models))
        yield f"  COLMAP also made separate models of {others} frames, which do not connect"
    if made.moving is not None:
        where = f"something moves by itself in {plural(len(made.moving), 'frame')}; see masks"
        yield "  " + (where if made.moving else "nothing moves by itself, so that no masks were written")
    yield f"{printable(str(made.folder))}: {plural(len(posed), 'frame')} with a pose; see report.html"
