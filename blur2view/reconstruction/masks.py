"""Masks of what moves by itself in the frames of a scene, under the names that programs look for."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import NamedTuple

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from blur2view.files import read_regular
from blur2view.images.image import read_picture
from blur2view.movers.mask import MaskFormat
from blur2view.networks.smear_network import SmearReader
from blur2view.output import write_file
from blur2view.pipeline import estimate, segment
from blur2view.reconstruction.static_points import StaticPoints
from blur2view.results.overlay import png

MASKS = "masks"  # folder of a scene
ENOUGH = 8  # frames, one in four of a video: if nothing moves in these, nothing does in those between
REACH = 0.1  # of the picture's longer side that what moves may get ahead from frame to frame


class Masks(NamedTuple):
    """What was written where anything moves by itself; nothing else."""

    files: list[str]  # paths below the scene's folder
    moving: list[str]  # frames in which anything moves, by name


def write_masks(
    scene: Path,
    images: str,
    names: Sequence[str],
    work: Path,
    network: SmearReader,
    *,
    points: StaticPoints,
    consecutive: bool = False,
    beside: bool = False,
    show: Callable[[int, int], None] = lambda done, count: None,
) -> Masks:
    """Write masks of frames if something moves by itself in any of them.

    All frames get one then, as nerfstudio wants all or none: NAME.jpg.png for COLMAP, NAME.png for
    nerfstudio's reader of COLMAP's models unless two frames have that stem; ``beside`` the frames also
    instant-ngp's. A part of a photograph that seems to move does not where the model's ``points`` are seen in
    it, and what moves in one of ``consecutive`` frames does so in the one before or after it, too. ``work``
    keeps what is done of a call that was ended.
    """
    found: dict[str, bytes] = {}
    for done, k in enumerate(sorted(range(len(names)), key=lambda k: (k % 2, k % 4) if consecutive else k)):
        show(done, len(names))
        name, kept = names[k], work / MaskFormat.COLMAP.path(PurePath(names[k]))
        if consecutive and done == len(names[::4]) >= ENOUGH and _all_still(found.values()):
            return Masks([], [])  # nothing moves: three frames in four need not be segmented
        if consecutive and k % 2 and _all_still(found[other] for other in names[k - 1 : k + 2 : 2]):
            # what moved here alone would be a mistake: half of the frames of a still scene are not segmented
            size = read_picture(scene / images / name, as_stored=True).size
            found[name] = png(np.full(size[::-1], 255, np.uint8))
            continue
        if not kept.is_file():
            pixels = read_picture(scene / images / name, as_stored=True).pixels
            mask = segment(estimate(pixels, network=network, geometry=False), pixels)
            write_file(kept, png(MaskFormat.COLMAP.picture(mask.labels)))
        moving = points.without_static(name, _decoded(read_regular(kept)) == 0)
        found[name] = png(np.where(moving, 0, 255).astype(np.uint8))
    found = {name: found[name] for name in names}
    if consecutive:
        found = dict(_confirmed(found))
    moving_frames = [name for name in names if not _all_still([found[name]])]
    if not moving_frames:
        return Masks([], [])
    paths = {f"{MASKS}/{MaskFormat.COLMAP.path(PurePath(name))}": found[name] for name in names}
    short = {name: f"{MASKS}/{MaskFormat.NERFSTUDIO.path(PurePath(name))}" for name in names}
    uses = Counter([*paths, *short.values()])
    paths |= {path: found[name] for name, path in short.items() if uses[path] == 1}
    if beside:
        paths |= {
            f"{images}/{MaskFormat.INSTANT_NGP.path(PurePath(name))}": png(255 - _decoded(mask))
            for name, mask in found.items()
        }
    for path, content in paths.items():
        write_file(scene / path, content)
    return Masks(list(paths), moving_frames)


def _confirmed(masks: Mapping[str, bytes]) -> Iterator[tuple[str, bytes]]:
    """Yield the masks (PNG, 0 where anything moves) of frames in order, without parts of one frame alone.

    Three masks are in memory as pixels.
    """
    names = list(masks)
    for k, name in enumerate(names):
        moving = _decoded(masks[name]) == 0
        count, parts = cv2.connectedComponents(moving.astype(np.uint8))
        near = np.zeros(moving.shape, bool)
        for beside in (*names[max(0, k - 1) : k], *names[k + 1 : k + 2]) if count > 1 else ():
            other = _decoded(masks[beside]) == 0
            if other.any() and other.shape == near.shape:
                near |= _grown(other)
        real = np.isin(parts, np.unique(parts[near & moving]))
        yield name, png(np.where(moving & real, 0, 255).astype(np.uint8))


def _all_still(masks: Iterable[bytes]) -> bool:
    """Return whether nothing moves in any of these masks."""
    return all(_decoded(mask).all() for mask in masks)


def _decoded(mask: bytes) -> AnyArray:
    """Return the pixels (H, W) of a mask."""
    return np.asarray(cv2.imdecode(np.frombuffer(mask, np.uint8), cv2.IMREAD_UNCHANGED))


def _grown(moving: AnyArray) -> AnyArray:
    """Return what lies within `REACH` of anything that moves."""
    away = cv2.distanceTransform((~moving).astype(np.uint8), cv2.DIST_L2, 3)
    return np.asarray(away <= REACH * max(moving.shape))
