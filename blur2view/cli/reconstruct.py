"""``blur2view reconstruct``: from a blurred video to a scene, whose every frame has a pose."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from blur2view.cli.options import Printing
from blur2view.cli.parser import exposure_s, flag, one_of, option, rare_option, required, whole
from blur2view.cli.terminal import plural, printable, waiting

if TYPE_CHECKING:
    from blur2view.reconstruction.reconstruct import Reconstruction

CAMERA_MODELS = ("SIMPLE_RADIAL", "SIMPLE_PINHOLE", "PINHOLE", "RADIAL", "OPENCV")
SHOWN = 3  # frames of each reason without -v
WRITTEN = """
images: the frames chosen, with --all-frames all
sparse/0: COLMAP's model, in which every image is a file
masks: where anything moves by itself, 0 there: NAME.jpg.png for COLMAP and transforms.json, NAME.png for
    nerfstudio's reader of COLMAP's models; for instant-ngp also images/dynamic_mask_NAME.png
exposures: the same with both ends of recovered frames' exposures, NAME#open and NAME#close
database.db: COLMAP's features and matches
transforms.json: for nerfstudio and its fork for motion blur, with the points in sparse_pc.ply, or instant-ngp
report.html: the video's blur over time, the camera's path, and the frames
reconstruction.json, work: by which the same call goes on where one was ended; a done step whose files are
    there is kept
"""
REMEDIES = {
    "too few points": "it shows little of what its neighbours show; --all-frames gives it nearer ones",
    "fewer than two": "it is far from all registered frames; --all-frames gives it nearer ones",
    "its pose": "look at it in the report; --all-frames gives it nearer neighbours",
}


@dataclass(frozen=True, kw_only=True)
class ReconstructOptions:
    """The options of ``blur2view reconstruct``.

    Make a scene of a video, or of a folder of its frames: COLMAP maps the sharpest frames, those that it
    refuses are recovered by their blur, and all is written for training. The same call goes on where one was
    ended.
    """

    video: Path = required("VIDEO: a video, or a folder of the frames of one")
    output: Path = required(
        "-o, --output DIR: where the scene goes: a new or empty folder, or that of an earlier call"
    )
    frames: Annotated[int, whole(3)] = option(
        "--frames N: choose the sharpest N frames at most, spread over the way (default: %(default)s)", 300
    )
    all_frames: bool = flag("--all-frames: also recover and keep all frames that are not chosen")
    camera: str = option(
        """--camera CAMERA: the camera, where it is known, as COLMAP writes it: "MODEL WIDTH HEIGHT
        PARAMS...", for example "SIMPLE_RADIAL 640 480 525 320 240 0.05"; it is kept (default: COLMAP finds
        it, beginning at the focal length of EXIF where there is one)""",
        "",
    )
    camera_model: Annotated[str, one_of(*CAMERA_MODELS)] = option(
        """--camera-model MODEL: what COLMAP finds, SIMPLE_RADIAL, SIMPLE_PINHOLE, PINHOLE, RADIAL or OPENCV
        (default: %(default)s); smears assume a lens without a fisheye's distortion""",
        CAMERA_MODELS[0],
    )
    mapper: Annotated[str, one_of("incremental", "global")] = rare_option(
        "--mapper NAME: COLMAP's incremental or global mapper (default: %(default)s)", "incremental"
    )
    dialect: Annotated[str, one_of("nerfstudio", "instant-ngp")] = option(
        "--dialect NAME: of transforms.json, nerfstudio or instant-ngp (default: %(default)s)", "nerfstudio"
    )
    exposure: Annotated[float, exposure_s] = rare_option(
        """--exposure S: exposure time in seconds, for nerfstudio's velocities (default: %(default)g)""", 1.0
    )
    masks: bool = option("--no-masks: without masks of what moves by itself: faster", True)
    jobs: int | None = option("--jobs N: processes that recover frames (default: one per core)")
    printing: Printing = Printing()

    examples = (
        "blur2view reconstruct clip.mp4 -o scene",
        "blur2view reconstruct frames -o scene --all-frames --dialect instant-ngp",
    )
    tables = {"what is written": WRITTEN}
    exit_codes = {
        "1": "failed, or COLMAP makes no model, with the cause on stderr",
        "130": "interrupted by Ctrl-C; the same call goes on",
    }

    def execute(self) -> int:
        """Return the exit code, after making the scene."""
        import pycolmap

        from blur2view.reconstruction.reconstruct import ReconstructionOptions, reconstruct

        pycolmap.logging.minloglevel = pycolmap.logging.Level.ERROR.value
        options = ReconstructionOptions(
            frames=self.frames,
            all_frames=self.all_frames,
            camera_model=self.camera_model,
            camera=self.camera,
            mapper=self.mapper,
            dialect=self.dialect,
            exposure_s=self.exposure,
            masks=self.masks,
        )
        step = partial(waiting, hidden=self.printing.quiet)
        made = reconstruct(self.video, self.output, options, jobs=self.jobs, step=step)
        if not self.printing.quiet:
            print("\n".join(table_of(made, verbose=self.printing.verbose)))
        return 0


def table_of(made: "Reconstruction", *, verbose: bool = False) -> Iterator[str]:
    """Yield the lines that say what has become of the frames of a video."""
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
        smear_px = made.median_smear_px(names)
        smear = "" if smear_px is None else f"  median smear {smear_px:.1f} px"
        yield f"{words + ':':<26}{len(names):>6}{smear}"
    for why, count in Counter(made.refused.values()).items():
        these = [name for name, reason in made.refused.items() if reason == why]
        listed = ", ".join(map(printable, these if verbose else these[:SHOWN]))
        more = "" if verbose or count <= SHOWN else f" and {count - SHOWN} more (-v)"
        remedy = next((f"; {text}" for start, text in REMEDIES.items() if why.startswith(start)), "")
        yield f"  refused, {printable(why)}: {listed}{more}{remedy}"
    if made.other_models:
        others = ", ".join(map(str, made.other_models))
        yield f"  COLMAP also made separate models of {others} frames, which do not connect"
    yield f"{printable(str(made.folder))}: {plural(len(posed), 'frame')} with a pose; see report.html"
