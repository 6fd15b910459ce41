"""``blur2view to-transforms``: its options and its help."""

from argparse import SUPPRESS
from pathlib import Path

from blur2view.cli.arguments import help_text, shared
from blur2view.colmap import DIALECTS

ABOUT = "write a COLMAP model with views as transforms.json, for radiance fields of blurred photographs"
DESCRIPTION = """
Write a COLMAP model with the views NAME#open and NAME#close, as blur2view place writes it, as the
transforms.json that trainers of radiance fields read: instant-ngp, which lets each ray of a frame look from a
random instant of its exposure, or the motion-blur fork of nerfstudio. The world is the model's, in its unit.
help("blur2view.colmap.transforms") has all conventions with their sources.
"""
KEYS = """
transform_matrix: world_from_camera at mid exposure; axes x right, y up, z backwards (OpenGL)
fl_x, cx, k1, ...: COLMAP's own numbers; above the frames, or in each if they have several cameras
instant-ngp: transform_matrix_start and _end at shutter-open and shutter-close; rolling_shutter [0, 0, 0, 1],
    a global shutter; sharpness, 1 / (1 + median smear in pixels); aabb_scale, scale and offset put the
    cameras into its box
nerfstudio: camera_linear_velocity (units of the model per second) and camera_angular_velocity (radians per
    second) in the camera's axes; exposure_time, rolling_shutter_time 0; ply_file_path: the model's points,
    sparse_pc.ply beside the file
order in time: which view came first does not matter to a photograph blurred by a global shutter
"""
EXAMPLES = (
    "blur2view to-transforms with_views",
    "blur2view to-transforms with_views --images frames -o ngp/transforms.json",
    "blur2view to-transforms with_views --dialect nerfstudio --exposure 0.02 -o splat/transforms.json",
)


def describe(parser: shared.CommandParser) -> None:
    """Add the options and the help of ``blur2view to-transforms``."""
    parser.description = help_text.paragraph(DESCRIPTION)
    given = parser.add_argument_group("input")
    given.add_argument("model", type=Path, metavar="MODEL", help="folder of a COLMAP model with views")
    given.add_argument(
        "--images",
        dest="photographs",
        type=Path,
        metavar="DIR",
        help="folder of the photographs (default: the one that blur2view place, or COLMAP, noted in "
        "MODEL/project.ini, or else images beside the file)",
    )
    given.add_argument(
        "--exposure",
        type=shared.seconds,
        default=1.0,
        metavar="S",
        help="exposure time in seconds, as 0.02 or 1/50, for nerfstudio; only its product with the "
        "velocities shows in a photograph (default: %(default)g, velocities per exposure)",
    )
    output = parser.add_argument_group("output")
    output.add_argument(
        "-o",
        "--output",
        type=shared.output_path,
        default=Path("transforms.json"),
        metavar="JSON",
        help="the file (default: %(default)s); one of an earlier call is replaced",
    )
    output.add_argument(
        "--dialect", choices=DIALECTS, default=DIALECTS[0], help="whose file (default: %(default)s)"
    )
    output.add_argument("--overwrite", action="store_true", help=SUPPRESS)
    shared.add_verbosity(output)
    parser.epilog = help_text.epilog(help_text.table("what is written", KEYS), examples=EXAMPLES)
