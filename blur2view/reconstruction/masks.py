"""Masks of what moves by itself in the frames of a scene, under the names that programs look for."""

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path, PurePath

import cv2
import numpy as np

from blur2view.files import read_regular, write_file
from blur2view.images.image import read_picture
from blur2view.movers.mask import MaskFormat
from blur2view.networks.smear_network import SmearReader
from blur2view.pipeline import estimate, segment
from blur2view.results.overlay import png

MASKS = "masks"  # folder of a scene


def write_masks(
    scene: Path,
    images: str,
    names: Sequence[str],
    work: Path,
    network: SmearReader,
    *,
    beside: bool = False,
    show: Callable[[int, int], None] = lambda done, count: None,
) -> list[str]:
    """Write masks of frames if something moves by itself in any; return their paths below the scene's folder.

    All frames get one then, as nerfstudio wants all or none: NAME.jpg.png for COLMAP, NAME.png for
    nerfstudio's reader of COLMAP's models unless two frames have that stem; ``beside`` the frames also
    instant-ngp's. ``work`` keeps what is done of a call that was ended.
    """
    for done, name in enumerate(names):
        show(done, len(names))
        if (kept := work / MaskFormat.COLMAP.path(PurePath(name))).is_file():
            continue
        pixels = read_picture(scene / images / name, as_stored=True).pixels
        mask = segment(estimate(pixels, network=network, geometry=False), pixels)
        write_file(kept, png(MaskFormat.COLMAP.picture(mask.labels)))
    found = {name: read_regular(work / MaskFormat.COLMAP.path(PurePath(name))) for name in names}
    pictures = {
        name: np.asarray(cv2.imdecode(np.frombuffer(mask, np.uint8), -1)) for name, mask in found.items()
    }
    if all(picture.all() for picture in pictures.values()):
        return []
    paths = {f"{MASKS}/{MaskFormat.COLMAP.path(PurePath(name))}": found[name] for name in names}
    short = {name: f"{MASKS}/{MaskFormat.NERFSTUDIO.path(PurePath(name))}" for name in names}
    uses = Counter([*paths, *short.values()])
    paths |= {path: found[name] for name, path in short.items() if uses[path] == 1}
    if beside:
        paths |= {
            f"{images}/{MaskFormat.INSTANT_NGP.path(PurePath(name))}": png(255 - picture)
            for name, picture in pictures.items()
        }
    for path, content in paths.items():
        write_file(scene / path, content)
    return list(paths)
