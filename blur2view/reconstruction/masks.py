"""Masks of what moves by itself in the frames of a scene, under the names that programs look for."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path, PurePath

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from blur2view.files import read_regular, write_file
from blur2view.images.image import read_picture
from blur2view.movers.mask import MaskFormat
from blur2view.networks.smear_network import SmearReader
from blur2view.pipeline import estimate, segment
from blur2view.results.overlay import png

MASKS = "masks"  # folder of a scene
REACH = 0.1  # of the picture's longer side that what moves may get ahead from frame to frame


def write_masks(
    scene: Path,
    images: str,
    names: Sequence[str],
    work: Path,
    network: SmearReader,
    *,
    consecutive: bool = False,
    beside: bool = False,
    show: Callable[[int, int], None] = lambda done, count: None,
) -> list[str]:
    """Write masks of frames if something moves by itself in any; return their paths below the scene's folder.

    All frames get one then, as nerfstudio wants all or none: NAME.jpg.png for COLMAP, NAME.png for
    nerfstudio's reader of COLMAP's models unless two frames have that stem; ``beside`` the frames also
    instant-ngp's. What moves in one of ``consecutive`` frames does so in the one before or after it, too,
    else it is a mistake. ``work`` keeps what is done of a call that was ended.
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
    if consecutive:
        pictures = _confirmed(pictures)
        found = {name: png(picture) for name, picture in pictures.items()}
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


def _confirmed(pictures: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """Return masks (H, W), 0 where anything moves, of frames in order, without parts of one frame alone."""
    moving = [picture == 0 for picture in pictures.values()]
    kept = dict[str, AnyArray]()
    for k, name in enumerate(pictures):
        beside = [other for other in (*moving[max(0, k - 1) : k], *moving[k + 1 : k + 2]) if other.any()]
        count, parts = cv2.connectedComponents(moving[k].astype(np.uint8))
        near = np.zeros(moving[k].shape, bool)
        for other in beside if count > 1 else ():
            if other.shape == near.shape:
                near |= _grown(other)
        real = np.isin(parts, np.unique(parts[near & moving[k]]))
        kept[name] = np.where(moving[k] & real, 0, 255).astype(np.uint8)
    return kept


def _grown(moving: AnyArray) -> AnyArray:
    """Return what lies within `REACH` of anything that moves."""
    away = cv2.distanceTransform((~moving).astype(np.uint8), cv2.DIST_L2, 3)
    return np.asarray(away <= REACH * max(moving.shape))
