"""``blur2view to-transforms``: a model with views as trainers of radiance fields read it."""

import json
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Annotated, Any

from blur2view import __version__
from blur2view.cli.options import Printing
from blur2view.cli.parser import Length, OneOf, exposure_s, length, option, required
from blur2view.cli.segment import ENDINGS
from blur2view.cli.terminal import plural, printable, waiting
from blur2view.colmap import transforms
from blur2view.colmap.models import DATABASE, PICTURES, noted, read_model, refuse_other_model, write_model
from blur2view.colmap.project import smear_lengths, storable
from blur2view.errors import DatabaseError, OutputError
from blur2view.files import open_picture, open_regular
from blur2view.images.image import RAW_SUFFIXES, read_orientation
from blur2view.images.pixels import stored_from_upright
from blur2view.movers.mask import DAMAGED, MaskFormat, stored_labels
from blur2view.output import check_file, signed, writable_folder, write_beside
from blur2view.results.overlay import png

MODEL, PHOTOGRAPHS = Path("sparse", "0"), Path("images")  # below the folder that gsplat is given
MASKS = "masks"  # beside transforms.json
LONG_SMEAR_PX = 3.0  # from which on photographs are counted as blurred, as in the example of --max-smear
Photographs = Sequence[transforms.Exposed]
KEYS = """
instant-ngp: transforms.json alone; the cameras are moved and scaled into instant-ngp's box
nerfstudio: transforms.json, and beside it the model's points in sparse_pc.ply; nerfstudio itself reads the
    same file and ignores the motion
gsplat: a folder with COLMAP's model of the photographs in sparse/0, and a link to the photographs in images
masks: nerfstudio gets masks/NAME.png beside the file, and mask_path of each frame; instant-ngp gets
    dynamic_mask_NAME.png beside each photograph
order in time: it does not matter which view came first, unless the photograph has a rolling shutter
"""


@dataclass(frozen=True, kw_only=True)
class ToTransformsOptions:
    """The options of ``blur2view to-transforms``.

    Write a COLMAP model with the views NAME#open and NAME#close, as "blur2view place" makes it, for a trainer
    of radiance fields. instant-ngp lets each ray of a frame look from a random instant of the exposure, and
    nerfstudio's fork for motion blur models the blur as well. nerfstudio itself and gsplat do not model blur,
    and take each frame as sharp at mid exposure; --max-smear leaves out the frames that are not sharp. The
    world and its unit are those of the model. help("blur2view.colmap.transforms") explains all conventions
    and names their sources.
    """

    model: Path = required("MODEL: folder of a COLMAP model with views")
    images_dir: Path | None = option("""--images DIR: folder of the photographs (default: the folder that
        MODEL/project.ini names, or else images beside the file)""")
    exposure: Annotated[float, exposure_s] = option(
        """--exposure S: exposure time in seconds for nerfstudio, such as 0.02 or 1/50; photographs show only
        its product with the velocities, so that 1 will do (default: %(default)g)""",
        1.0,
    )
    masks: Path | None = option("""--masks-from DIR: folder of results of "blur2view segment" for these
        photographs; their masks are written where the trainer reads them""")
    max_smear: Annotated[Length | None, length] = option("""--max-smear PX: leave out photographs whose smear
        is unknown or longer than this, in pixels or, as 0.3%%, in per cent of the width (default: keep
        all)""")
    output: Path = option(
        """-o, --output JSON: file to write, or for gsplat a folder (default: %(default)s); the result of an
        earlier call is replaced""",
        Path("transforms.json"),
    )
    dialect: Annotated[str, OneOf(*transforms.DIALECTS)] = option(
        "--dialect NAME: trainer to write for, instant-ngp, nerfstudio or gsplat (default: %(default)s)",
        transforms.DIALECTS[0],
    )
    printing: Printing = Printing()

    examples = (
        "blur2view to-transforms with_views --images frames -o ngp/transforms.json",
        "blur2view to-transforms with_views --dialect nerfstudio --exposure 0.02 -o splat/transforms.json",
        "blur2view to-transforms with_views --masks-from masks -o ngp/transforms.json",
        "blur2view to-transforms with_views --dialect gsplat --max-smear 3 -o splat",
    )
    exit_codes = {"1": "failed; stderr has a line with the reason, and transforms.json is not written"}
    tables = {"what is written": KEYS}

    def __post_init__(self) -> None:
        if self.dialect == transforms.GSPLAT and (self.masks is not None or self.output.suffix == ".json"):
            raise ValueError(
                "gsplat reads a folder and no masks; name a folder with -o, and omit --masks-from"
            )

    def execute(self) -> int:
        """Return the exit code, after writing for the trainer."""
        gsplat = self.dialect == transforms.GSPLAT
        beside = self.output if gsplat else self.output.parent
        images = self.images_dir or noted(self.model, PICTURES) or beside / PHOTOGRAPHS
        if not gsplat:
            check_file(self.output)
            writable_folder(beside)
        with waiting(f"reading {self.model}", hidden=self.printing.quiet):
            model = read_model(self.model)
        candidates = self._short_enough(model, transforms.exposed_images(model, self.model))
        photographs = [photograph for photograph in candidates if (images / photograph.image.name).is_file()]
        if not photographs:
            missing = images / candidates[0].image.name
            raise OutputError(
                f"{missing}: neither this photograph nor any other one is there; name their folder with "
                f"--images"
            )
        registered = {image.name for image in model.images.values() if image.has_pose}
        unregistered = smear_lengths(noted(self.model, DATABASE) or self.model).keys() - registered
        write = _write_folder if gsplat else _write_file
        with waiting(f"writing {self.output}", hidden=self.printing.quiet):
            line = write(self, model, photographs, images)
        if absent := len(candidates) - len(photographs):
            line += f"; left out {plural(absent, 'photograph')} of the model not in {printable(str(images))}"
        if unregistered:
            line += f"; {plural(len(unregistered), 'linked frame')} not in the model (blur2view recover)"
        if not self.printing.quiet:
            print(f"{printable(str(self.output))}: wrote {line}")
        return 0

    def _short_enough(self, model: Any, photographs: Photographs) -> Photographs:
        """Return the photographs with smears up to ``--max-smear``; DatabaseError if there is none."""
        if (limit := self.max_smear) is None:
            return photographs
        short = [
            photograph
            for photograph in photographs
            if photograph.smear_px is not None
            and photograph.smear_px <= limit.px(model.cameras[photograph.image.camera_id].width)
        ]
        if not short:
            unit = "of the width" if limit.of_width else "px"
            raise DatabaseError(f"{self.model}: all smears are longer than {limit} {unit}; raise --max-smear")
        return short


def _sizes(model: Any, photographs: Photographs, images: Path) -> dict[str, tuple[int, int]]:
    """Return (width, height) of photographs by name, as files store them; of no picture its camera's.

    OutputError if one shows only a part of what its camera sees.
    """
    sizes = dict[str, tuple[int, int]]()
    for image, *_ in photographs:
        path, camera = images / image.name, model.cameras[image.camera_id]
        size = (camera.width, camera.height)
        if path.suffix.lower() not in RAW_SUFFIXES:  # in which Pillow sees a thumbnail
            with suppress(*DAMAGED), open_regular(path) as file, open_picture(file) as picture:
                size = picture.size
        try:
            transforms.scaled(camera, size)
        except ValueError as error:
            remedy = "name the folder of the model's photographs with --images; they may have another size"
            raise OutputError(f"{path}: {error} of its camera; {remedy}") from None
        sizes[image.name] = size
    return sizes


def _write_file(options: ToTransformsOptions, model: Any, photographs: Photographs, images: Path) -> str:
    """Write the file with its masks and points; return the words that say so."""
    target, masks, sizes = options.output, options.masks, _sizes(model, photographs, images)
    images_path = os.path.relpath(images, target.parent)
    if not storable(images_path):
        raise OutputError(
            f"{images_path}: cannot be named in {target.name}, because it is not UTF-8; rename the folder"
        )
    content = transforms.transforms_content(
        model,
        options.model,
        photographs,
        dialect=options.dialect,
        images=images_path,
        sizes=sizes,
        exposure_s=options.exposure,
    )
    line, files, own_files = plural(len(photographs), "frame"), dict[Path, bytes](), dict[Path, bytes]()
    if masks is not None:
        paths = _mask_paths(options, [*sizes], images)
        files = {
            path: _mask(options, masks, images / name, name, sizes[name]) for path, name in paths.items()
        }
        line += f" and their masks, {printable(str(_mask_path(options, 'NAME', images)))}"
        if options.dialect != transforms.INSTANT_NGP:
            for frame, path in zip(content["frames"], files, strict=True):
                frame["mask_path"] = path.relative_to(target.parent).as_posix()
    if transforms.PLY_KEY in content:
        check_file(target.parent / transforms.PLY)
        own_files[target.parent / transforms.PLY] = transforms.point_cloud(model)
        line += f" and their points, {transforms.PLY}"
    own_files[target] = (json.dumps(signed(content, __version__), indent=2, allow_nan=False) + "\n").encode()
    if files:
        write_beside(files)
    write_beside(own_files, noted=True)
    still = sum(not photograph.views for photograph in photographs)
    if still:
        line += f", {still} of them without views and taken as sharp (blur2view place adds views)"
    cameras = (model.cameras[photograph.image.camera_id] for photograph in photographs)
    if [*sizes.values()] != [(camera.width, camera.height) for camera in cameras]:
        line += ", cameras scaled to the size of the photographs"
    return line


def _mask_path(options: ToTransformsOptions, name: str, images: Path) -> Path:
    """Return where the trainer looks for the mask of a photograph."""
    beside = options.dialect == transforms.INSTANT_NGP
    below = images if beside else options.output.parent / MASKS
    return below / MaskFormat(options.dialect).path(PurePath(name))


def _mask_paths(options: ToTransformsOptions, names: Sequence[str], images: Path) -> dict[Path, str]:
    """Return the names of photographs by the paths of their masks, all of which can be written."""
    paths = dict[Path, str]()
    for name in names:
        path = _mask_path(options, name, images)
        if path in paths:
            raise OutputError(f"{path}: would be the mask of two photographs; rename one")
        check_file(path)
        paths[path] = name
    for folder in {path.parent for path in paths}:
        writable_folder(folder)
    return paths


def _mask(
    options: ToTransformsOptions, folder: Path, photograph: Path, name: str, size: tuple[int, int]
) -> bytes:
    """Return the mask (PNG) of a photograph (width, height) from the folder of a segmentation."""
    called = PurePath(name).with_suffix(""), PurePath(name)  # by segment, the latter where two have one stem
    masks = [path for stem in called if (path := folder / f"{stem}{ENDINGS[0]}").is_file()]
    if not masks:
        remedy = "make it with blur2view segment -o DIR, and name DIR"
        raise OutputError(f"{folder}: has no mask of {name}; {remedy}")
    labels = stored_from_upright(stored_labels(masks[0]), read_orientation(photograph))
    if labels.shape != size[::-1]:
        shape = f"{labels.shape[1]}x{labels.shape[0]} pixels, but its photograph has {size[0]}x{size[1]}"
        raise OutputError(f"{masks[0]}: has {shape}; segment the photographs in {photograph.parent}")
    return png(MaskFormat(options.dialect).picture(labels))


def _write_folder(options: ToTransformsOptions, model: Any, photographs: Photographs, images: Path) -> str:
    """Write gsplat's folder, their model and a link to the photographs; return the words that say so."""
    folder, link = options.output / MODEL, options.output / PHOTOGRAPHS
    refuse_other_model(folder, options.model)
    if os.path.lexists(link) and os.path.realpath(link) != os.path.realpath(images):
        raise OutputError(f"{link}: is not the folder {images}, where the photographs are; move it away")
    names = _sizes(model, photographs, images).keys()  # gsplat scales the cameras by itself
    selection = transforms.keep_photographs(model, names)
    write_model(selection, folder, images)
    if not os.path.lexists(link):
        link.symlink_to(os.path.abspath(images), target_is_directory=True)
    line = f"{plural(len(selection.images), 'photograph')} as sharp at mid exposure"
    smears = [photograph.smear_px or 0.0 for photograph in photographs]
    blurred = sum(smear_px > LONG_SMEAR_PX for smear_px in smears)
    if blurred and options.max_smear is None:
        has = "has a smear" if blurred == 1 else "have smears"
        longer = f"{blurred} of them {has} of more than {LONG_SMEAR_PX:g} px, up to {max(smears):.0f} px"
        line += f"; {longer} (--max-smear {LONG_SMEAR_PX:g} leaves out what is longer)"
    return line
