"""``blur2view to-transforms``: a model with views as trainers of radiance fields read it."""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Annotated, Any

from blur2view import __version__
from blur2view.cli.options import Printing
from blur2view.cli.parser import exposure_s, one_of, option, radius, required
from blur2view.cli.segment import ENDINGS
from blur2view.cli.terminal import plural, printable, waiting
from blur2view.colmap import transforms
from blur2view.colmap.models import DATABASE, PICTURES, noted, read_model, refuse_other_model, write_model
from blur2view.colmap.project import smear_lengths
from blur2view.errors import OutputError
from blur2view.files import check_file, write_beside
from blur2view.movers.mask import MaskFormat, as_stored, stored_labels
from blur2view.results.overlay import png

MODEL, PHOTOGRAPHS = Path("sparse", "0"), Path("images")  # below the folder that gsplat is given
MASKS = "masks"  # beside transforms.json
Photographs = Sequence[transforms.Exposed]
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
    dialect: Annotated[str, one_of(*transforms.DIALECTS)] = option(
        "--dialect NAME: for which trainer: instant-ngp, nerfstudio or gsplat (default: %(default)s)",
        transforms.DIALECTS[0],
    )
    printing: Printing = Printing()

    examples = (
        "blur2view to-transforms with_views --images frames -o ngp/transforms.json",
        "blur2view to-transforms with_views --dialect nerfstudio --exposure 0.02 -o splat/transforms.json",
        "blur2view to-transforms with_views --masks-from masks -o ngp/transforms.json",
        "blur2view to-transforms with_views --dialect gsplat --max-smear 3 -o splat",
    )
    tables = {"what is written": KEYS}

    def __post_init__(self) -> None:
        if self.dialect == transforms.GSPLAT and (self.masks is not None or self.output.suffix == ".json"):
            raise ValueError("gsplat reads a folder, named with -o, and no masks")

    def execute(self) -> int:
        """Return the exit code, after writing for the trainer."""
        gsplat = self.dialect == transforms.GSPLAT
        beside = self.output if gsplat else self.output.parent
        images = self.photographs or noted(self.model, PICTURES) or beside / PHOTOGRAPHS
        if not gsplat:
            check_file(self.output)
        with waiting(f"reading {self.model}", hidden=self.printing.quiet):
            model = read_model(self.model)
        listed = transforms.exposed_images(model, self.model, self.max_smear or float("inf"))
        photographs = [photograph for photograph in listed if (images / photograph.image.name).is_file()]
        if not photographs:
            missing = images / listed[0].image.name
            raise OutputError(
                f"{missing}: no such photograph, nor any other; name their folder with --images"
            )
        there = {image.name for image in model.images.values() if image.has_pose}
        lost = smear_lengths(noted(self.model, DATABASE) or self.model).keys() - there
        write = _write_folder if gsplat else _write_file
        with waiting(f"writing {self.output}", hidden=self.printing.quiet):
            line = write(self, model, photographs, images)
        if absent := len(listed) - len(photographs):
            line += f"; left out {plural(absent, 'photograph')} of the model not in {printable(str(images))}"
        if lost:
            line += f"; {plural(len(lost), 'linked frame')} not in the model (blur2view recover)"
        if not self.printing.quiet:
            print(f"{printable(str(self.output))}: wrote {line}")
        return 0


def _write_file(options: ToTransformsOptions, model: Any, photographs: Photographs, images: Path) -> str:
    """Write the file with its masks and points; return the words that say so."""
    target = options.output
    content = transforms.content_of(
        model,
        options.model,
        photographs,
        dialect=options.dialect,
        images=os.path.relpath(images, target.parent),
        exposure_s=options.exposure,
    )
    files = {} if options.masks is None else _masks(options, options.masks, model, photographs, images)
    if options.masks is not None and options.dialect != transforms.INSTANT_NGP:
        for frame, path in zip(content["frames"], files, strict=True):
            frame["mask_path"] = path.relative_to(target.parent).as_posix()
    line = plural(len(photographs), "frame")
    if options.masks is not None:
        line += " and their masks"
    if transforms.PLY_KEY in content:
        files[target.parent / transforms.PLY] = transforms.point_cloud(model)
        line += f" and their points, {transforms.PLY}"
    for path in files:
        check_file(path)
    content = {"generator": f"blur2view {__version__}", **content}
    files[target] = (json.dumps(content, indent=2, allow_nan=False) + "\n").encode()
    write_beside(files)
    still = sum(not photograph.views for photograph in photographs)
    if still:
        line += f", {still} of them without views, as if sharp (blur2view place gives them)"
    return line


def _masks(
    options: ToTransformsOptions, folder: Path, model: Any, photographs: Photographs, images: Path
) -> dict[Path, bytes]:
    """Return the masks of photographs, in their order, by the paths at which the trainer reads them."""
    program, files = MaskFormat(options.dialect), dict[Path, bytes]()
    for image, *_ in photographs:
        name = PurePath(image.name)
        called = name.with_suffix(""), name  # by segment, the latter where two have one stem
        masks = [path for stem in called if (path := folder / f"{stem}{ENDINGS[0]}").is_file()]
        if not masks:
            remedy = "make it with blur2view segment and name its folder, that of -o"
            raise OutputError(f"{folder}: has no mask of {name}; {remedy}")
        labels, camera = as_stored(stored_labels(masks[0]), images / name), model.cameras[image.camera_id]
        if labels.shape != (camera.height, camera.width):
            raise OutputError(
                f"{masks[0]}: is of {labels.shape[1]}x{labels.shape[0]} pixels, its photograph of "
                f"{camera.width}x{camera.height}; segment the photographs of the model"
            )
        below = images if program is MaskFormat.INSTANT_NGP else options.output.parent / MASKS
        path = below / program.path(name)
        if path in files:
            raise OutputError(f"{path}: would be the mask of two photographs; rename one")
        files[path] = png(program.picture(labels))
    return files


def _write_folder(options: ToTransformsOptions, model: Any, photographs: Photographs, images: Path) -> str:
    """Write gsplat's folder, their model and a link to the photographs; return the words that say so."""
    folder, link = options.output / MODEL, options.output / PHOTOGRAPHS
    transforms.keep_photographs(model, options.model, {photograph.image.name for photograph in photographs})
    refuse_other_model(folder)
    if os.path.lexists(link) and os.path.realpath(link) != os.path.realpath(images):
        raise OutputError(f"{link}: is not the folder {images}, where the photographs are; move it away")
    write_model(model, folder, images)
    if not os.path.lexists(link):
        link.symlink_to(os.path.abspath(images), target_is_directory=True)
    return f"{plural(len(photographs), 'photograph')} as sharp at mid exposure"
