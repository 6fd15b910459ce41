"""``blur2view to-transforms``: a model with views as trainers of radiance fields read it."""

import json
import os
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Annotated, Any

from blur2view import __version__
from blur2view.cli.options import Printing
from blur2view.cli.parser import exposure_s, one_of, option, radius, required
from blur2view.cli.segment import ENDINGS
from blur2view.cli.terminal import plural, printable
from blur2view.colmap import DIALECTS, GSPLAT
from blur2view.colmap.models import DATABASE, PICTURES, noted, read_model, refuse_other_model, write_model
from blur2view.colmap.project import smear_lengths
from blur2view.colmap.transforms import PLY_KEY, keep_photographs, point_cloud, transforms, with_views
from blur2view.errors import OutputError
from blur2view.exposure.views import OPEN
from blur2view.files import check_file, is_ours, unwritable, write_beside
from blur2view.movers.mask import MaskFormat, as_stored, stored_labels
from blur2view.results.overlay import png

MODEL, PHOTOGRAPHS = Path("sparse", "0"), Path("images")  # below the folder that gsplat is given
MASKS = "masks"  # beside transforms.json
KEYS = """
instant-ngp: transforms.json alone, whose cameras are put into its box
nerfstudio: the file, and beside it the model's points, sparse_pc.ply; its main line reads the same without
    the motion
gsplat: no file but a folder: sparse/0, COLMAP's model with the photographs alone, and images, a link to them
masks: nerfstudio masks/NAME.png beside the file, and mask_path of each frame; instant-ngp
    dynamic_mask_NAME.png beside each photograph, where it looks for it
order in time: which view came first does not matter to a photograph blurred by a global shutter
"""


@dataclass(frozen=True, kw_only=True)
class ToTransformsOptions:
    """The options of ``blur2view to-transforms``.

    Write a COLMAP model with the views NAME#open and NAME#close, as blur2view place writes it, as the
    transforms.json that trainers of radiance fields read: instant-ngp, which lets each ray of a frame look
    from a random instant of its exposure, or the motion-blur fork of nerfstudio. The main line of nerfstudio
    and gsplat know no blur and take each frame as sharp at mid exposure; --max-smear leaves out what is not.
    The world is the model's, in its unit. help("blur2view.colmap.transforms") has all conventions with their
    sources.
    """

    model: Path = required("MODEL: folder of a COLMAP model with views")
    photographs: Path | None = option("""--images DIR: folder of the photographs (default: the one that
        blur2view place, or COLMAP, noted in MODEL/project.ini, or else images beside the file)""")
    exposure: Annotated[float, exposure_s] = option(
        """--exposure S: exposure time in seconds, as 0.02 or 1/50, for nerfstudio; only its product with
        the velocities shows in a photograph (default: %(default)g, velocities per exposure)""",
        1.0,
    )
    masks: Path | None = option("""--masks-from DIR: results of blur2view segment of these photographs, whose
        masks are put where the trainer reads them""")
    max_smear: Annotated[float | None, radius] = option("""--max-smear PX: leave out photographs whose smear
        is longer, in pixels, or unknown (default: keep all); a sharp one has none""")
    output: Path = option(
        """-o, --output JSON: the file, for gsplat a folder (default: %(default)s); one of an earlier call
        is replaced""",
        Path("transforms.json"),
    )
    dialect: Annotated[str, one_of(*DIALECTS, GSPLAT)] = option(
        "--dialect NAME: for which trainer: instant-ngp, nerfstudio or gsplat (default: %(default)s)",
        DIALECTS[0],
    )
    printing: Printing = Printing()

    examples = (
        "blur2view to-transforms with_views",
        "blur2view to-transforms with_views --images frames -o ngp/transforms.json",
        "blur2view to-transforms with_views --dialect nerfstudio --exposure 0.02 -o splat/transforms.json",
        "blur2view to-transforms with_views --masks-from masks -o ngp/transforms.json",
        "blur2view to-transforms with_views --dialect gsplat --max-smear 3 -o splat",
    )
    tables = {"what is written": KEYS}

    def execute(self) -> int:
        """Return the exit code, after writing for the trainer."""
        line = _write_model(self) if self.dialect == GSPLAT else _write_transforms(self)
        line += _linked(self.model)
        if not self.printing.quiet:
            print(f"{printable(str(self.output))}: wrote {line}")
        return 0


def _write_transforms(options: ToTransformsOptions) -> str:
    """Write the file, masks, and the points beside it where it names them; return what was written."""
    target = options.output
    check_file(target)
    images = options.photographs or noted(options.model, PICTURES) or target.parent / PHOTOGRAPHS
    model = read_model(options.model)
    content = transforms(
        model,
        options.model,
        dialect=options.dialect,
        images=os.path.relpath(images, target.parent),
        exposure_s=options.exposure,
        max_smear_px=options.max_smear or float("inf"),
    )
    frames = {Path(os.path.normpath(target.parent / one["file_path"])): one for one in content["frames"]}
    of_model, frames = len(frames), _present(frames)
    files = {} if options.masks is None else _masks(options, options.masks, content, frames, images)
    if PLY_KEY in content:
        cloud = target.parent / content[PLY_KEY]
        check_file(cloud)
        files[cloud] = point_cloud(model)
    content = {"generator": f"blur2view {__version__}", **content, "frames": list(frames.values())}
    files[target] = (json.dumps(content, indent=2, allow_nan=False) + "\n").encode()
    write_beside(files)
    moving = ("transform_matrix_start", "camera_linear_velocity")  # of instant-ngp, and of nerfstudio
    still = sum(not any(any(frame.get(key, ())) for key in moving) for frame in frames.values())
    line = plural(len(frames), "frame") + " and their masks" * (options.masks is not None)
    line += f" and their points, {content[PLY_KEY]}" if PLY_KEY in content else ""
    line += f", {still} of them without views, as if sharp (blur2view place gives them)" * (still > 0)
    return line + _absent(of_model - len(frames), images)


def _linked(folder: Path) -> str:
    """Return what became of the frames with views in the database that a model names, to add to a line."""
    there = {image.name for image in read_model(folder).images.values() if image.has_pose}
    linked = smear_lengths(noted(folder, DATABASE) or folder)
    absent = sum(name not in there for name in linked)
    views = sum(f"{name}{OPEN}" in there for name in linked)
    counts = {"with views": views, "without": len(linked) - absent - views, "not in the model": absent}
    said = ", ".join(f"{count} {words}" for words, count in counts.items() if count)
    return f"; of {plural(len(linked), 'linked frame')} {said}" * bool(linked)


def _present(photographs: dict[Path, Any]) -> dict[Path, Any]:
    """Return the photographs that are there, with what belongs to each; OutputError if none is."""
    present = {path: one for path, one in photographs.items() if path.is_file()}
    if not present:
        path = next(iter(photographs))
        raise OutputError(f"{path}: no such photograph, nor any other; name their folder with --images")
    return present


def _absent(count: int, images: Path) -> str:
    """Return the words about photographs that are left out as their files are not there."""
    words = f"; left out {plural(count, 'photograph')} of the model not in {printable(str(images))}"
    return words * (count > 0)


def _masks(
    options: ToTransformsOptions, folder: Path, content: dict[str, Any], frames: dict[Path, Any], images: Path
) -> dict[Path, bytes]:
    """Return the masks that the trainer reads by their paths, and name them in the frames where it asks."""
    program, files = MaskFormat(options.dialect), dict[Path, bytes]()
    names = [PurePath(os.path.relpath(path, images)) for path in frames]
    stems = [name.stem for name in names]
    for name, (photograph, frame) in zip(names, frames.items(), strict=True):
        # as segment calls them: subfolder and stem, the stem alone, or the whole name where two have one stem
        called = [name.with_suffix(""), *([PurePath(name.stem)] * (stems.count(name.stem) == 1)), name]
        masks = [path for one in called if (path := folder / f"{one}{ENDINGS[0]}").is_file()]
        if not masks:
            remedy = "make it with blur2view segment and name its folder, that of -o"
            raise OutputError(f"{folder}: has no mask of {name}; {remedy}")
        labels = as_stored(stored_labels(masks[0]), photograph)
        size = tuple(frame.get(key, content.get(key)) for key in ("w", "h"))
        if labels.shape[::-1] != size:
            raise OutputError(
                f"{masks[0]}: is of {labels.shape[1]}x{labels.shape[0]} pixels, its photograph of "
                f"{size[0]}x{size[1]}; segment the photographs of the model"
            )
        path = options.output.parent / MASKS / program.path(name)
        if program is MaskFormat.INSTANT_NGP:
            path = photograph.parent / path.name
        if path in files or (os.path.lexists(path) and not is_ours(path)):
            raise OutputError(f"{path}: is no mask of an earlier call of {name}; move it away")
        files[path] = png(program.picture(labels))
        if program is MaskFormat.NERFSTUDIO:
            frame["mask_path"] = path.relative_to(options.output.parent).as_posix()
    return files


def _write_model(options: ToTransformsOptions) -> str:
    """Write the folder that gsplat reads: the model of the photographs, and a link to them."""
    if options.masks is not None or options.output.suffix == ".json":
        raise OutputError("gsplat reads a folder, named with -o, and no masks")
    folder, link = options.output / MODEL, options.output / PHOTOGRAPHS
    images = options.photographs or noted(options.model, PICTURES) or link
    model = read_model(options.model)
    kept = [image.name for image, _, _ in with_views(model, options.model, options.max_smear or float("inf"))]
    names = set(_present({images / name: name for name in kept}).values())
    keep_photographs(model, options.model, names)
    refuse_other_model(folder)
    if os.path.lexists(link) and os.path.realpath(link) != os.path.realpath(images):
        raise OutputError(f"{link}: is not the folder {images}, where the photographs are; move it away")
    write_model(model, folder, images)
    if not os.path.lexists(link):
        try:
            link.symlink_to(os.path.abspath(images), target_is_directory=True)
        except OSError as error:
            raise unwritable(options.output, error) from None
    line = f"{plural(len(names), 'photograph')} as sharp at mid exposure"
    return line + _absent(len(kept) - len(names), images)
