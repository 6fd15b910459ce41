"""What trainers of radiance fields read of a scene: transforms.json and the points beside it."""

import json
from pathlib import Path, PurePath

from blur2view import __version__
from blur2view.colmap import transforms
from blur2view.colmap.models import read_model
from blur2view.errors import DatabaseError
from blur2view.movers.mask import MaskFormat
from blur2view.output import check_file, signed, write_beside
from blur2view.reconstruction.masks import MASKS
from blur2view.reconstruction.options import ReconstructionOptions
from blur2view.reconstruction.scene import EXPOSURES, IMAGES, TRANSFORMS


def write_transforms(folder: Path, options: ReconstructionOptions, *, masked: bool) -> int:
    """Write the scene for a trainer, with its masks if it is ``masked``; return how many frames it has."""
    model = read_model(folder / EXPOSURES)
    posed = {image.name: image for image in model.images.values() if image.has_pose}
    try:
        exposed = transforms.exposed_images(model, folder / EXPOSURES)
    except DatabaseError:  # no frame is blurred
        exposed = [transforms.Exposed(posed[name], (), None) for name in sorted(posed)]
    content = transforms.transforms_content(
        model,
        folder / EXPOSURES,
        exposed,
        dialect=options.dialect,
        images=IMAGES,
        exposure_s=options.exposure_s,
    )
    if masked and options.dialect == transforms.NERFSTUDIO:
        for frame, exposure in zip(content["frames"], exposed, strict=True):
            frame["mask_path"] = f"{MASKS}/{MaskFormat.COLMAP.path(PurePath(exposure.image.name))}"
    files = {folder / transforms.PLY: transforms.point_cloud(model)} if transforms.PLY_KEY in content else {}
    files[folder / TRANSFORMS] = (
        json.dumps(signed(content, __version__), indent=2, allow_nan=False) + "\n"
    ).encode()
    for file in files:
        check_file(file)
    write_beside(files, noted=True)
    return len(exposed)
