"""``blur2view to-transforms``: its options and its help."""

from argparse import SUPPRESS
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import ClassVar

from blur2view.cli.arguments import values
from blur2view.cli.arguments.option import INPUT, Options, Rows, option
from blur2view.colmap import DIALECTS, GSPLAT

KEYS = """
transform_matrix: world_from_camera at mid exposure; axes x right, y up, z backwards (OpenGL)
fl_x, cx, k1, ...: COLMAP's own numbers; above the frames, or in each if they have several cameras
instant-ngp: transform_matrix_start and _end at shutter-open and shutter-close; rolling_shutter [0, 0, 0, 1],
    a global shutter; sharpness, 1 / (1 + median smear in pixels); aabb_scale, scale and offset put the
    cameras into its box
nerfstudio: camera_linear_velocity (units of the model per second) and camera_angular_velocity (radians per
    second) in the camera's axes; exposure_time, rolling_shutter_time 0; ply_file_path: the model's points,
    sparse_pc.ply beside the file; the main line of nerfstudio reads the same file without the motion
gsplat: no file but a folder: sparse/0, COLMAP's model with the photographs alone, and images, a link to them
masks: nerfstudio masks/NAME.png beside the file, and mask_path of each frame; instant-ngp
    dynamic_mask_NAME.png beside each photograph, where it looks for it
order in time: which view came first does not matter to a photograph blurred by a global shutter
"""


@dataclass(frozen=True, kw_only=True)
class ToTransformsOptions(Options):
    """The options of ``blur2view to-transforms``.

    Write a COLMAP model with the views NAME#open and NAME#close, as blur2view place writes it, as the
    transforms.json that trainers of radiance fields read: instant-ngp, which lets each ray of a frame look
    from a random instant of its exposure, or the motion-blur fork of nerfstudio. The main line of nerfstudio
    and gsplat know no blur and take each frame as sharp at mid exposure; --max-smear leaves out what is not.
    The world is the model's, in its unit. help("blur2view.colmap.transforms") has all conventions with their
    sources.
    """

    command = "to-transforms"
    model: Path = option(MISSING, "MODEL", group=INPUT)
    "folder of a COLMAP model with views"
    photographs: Path | None = option(None, "DIR", group=INPUT, names="--images")
    """folder of the photographs (default: the one that blur2view place, or COLMAP, noted in
    MODEL/project.ini, or else images beside the file)"""
    exposure: float = option(1.0, "S", group=INPUT, convert=values.exposure)
    """exposure time in seconds, as 0.02 or 1/50, for nerfstudio; only its product with the velocities shows
    in a photograph (default: %(default)g, velocities per exposure)"""
    masks: Path | None = option(None, "DIR", group=INPUT)
    "results of blur2view segment of these photographs, whose masks are put where the trainer reads them"
    max_smear: float | None = option(None, "PX", group=INPUT, convert=values.radius)
    "leave out photographs whose median smear is longer, in pixels (default: keep all)"
    output: Path = option(Path("transforms.json"), "JSON", names="-o --output")
    "the file, for gsplat a folder (default: %(default)s); one of an earlier call is replaced"
    dialect: str = option(DIALECTS[0], choices=(*DIALECTS, GSPLAT))
    "for which trainer (default: %(default)s)"
    overwrite: bool = option(False, help=SUPPRESS)  # which does nothing here

    tables: ClassVar[dict[str, Rows]] = {"what is written": KEYS}
    examples = (
        "blur2view to-transforms with_views",
        "blur2view to-transforms with_views --images frames -o ngp/transforms.json",
        "blur2view to-transforms with_views --dialect nerfstudio --exposure 0.02 -o splat/transforms.json",
        "blur2view to-transforms with_views --masks masks -o ngp/transforms.json",
        "blur2view to-transforms with_views --dialect gsplat --max-smear 3 -o splat",
    )
