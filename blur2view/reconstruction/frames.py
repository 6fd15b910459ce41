"""The frames of a video, and which of them COLMAP gets: the sharpest of each stretch of the camera's way."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain, count
from pathlib import Path, PurePath
from typing import NamedTuple

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from blur2view.colmap.blur_matching import equalised
from blur2view.errors import ImageError
from blur2view.images.image import read_picture
from blur2view.images.inputs import Source, encode_png, frame_file, list_photographs
from blur2view.images.pixels import gradient_energy
from blur2view.images.video import EndOfVideo, read_frame
from blur2view.reconstruction.options import MIN_FRAMES

# of photographs; of the others pycolmap 4.2 finds no features in AVIF, JPEG 2000 and WebP
READ_BY_COLMAP = frozenset([".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".pnm", ".ppm", ".tif", ".tiff"])
THUMBNAIL_PX = 160  # longer side of what shows how the picture moves
STRETCH = 0.04  # of the picture's longer side that it moves in a stretch
FEWEST = 12  # stretches, where there are so many frames
FEW = 60  # frames of a camera that moves, up to which all are chosen
# Of a smear: COLMAP registers longer ones worse than `recover_frames` does. With 8 px instead of 12 scenes of
# three rendered videos (`tools.evaluation.reconstructed`) are off by 0.046, 0.021 and 0.016 degrees (before:
# 0.063, 0.023 and 0.016), and by 0.06, 0.03 and 0.03 steps (before: 0.09, 0.02 and 0.03).
MAX_MAPPED_PX = 8.0, 12.0
MIN_SHARP = 0.4  # share of the chosen frames that must be sharper for one of these to hold
# A camera stood still where so many corners of its sharpest frame are at most so far, of the longer side,
# from their places in every other one. COLMAP calls a pair planar where 0.8 of its matches fit a homography,
# and begins with points that are seen at 4 degrees; in a picture of 60 degrees this way is a third of one.
STILL_CORNERS, STILL_MOVE = 0.8, 0.005
CORNERS, FEWEST_CORNERS, CORNERS_APART = 600, 60, 0.02  # the last of the longer side


class Frame(NamedTuple):
    """A frame that was looked at."""

    name: str  # below ``images``
    number: int  # in the video, or its place in the folder
    energy: float  # of the gradient: how sharp it is among its neighbours
    moved: float  # of the picture since the frame before, of its longer side


def list_frames(video: Path) -> list[tuple[str, Source]]:
    """Return the frames of a video or folder by the names that they get; ImageError if there are none."""
    if not os.path.lexists(video):
        raise ImageError(f"{video}: no such video or folder; check the path")
    inputs = list_photographs([str(video)], recursive=True).readable()
    if inputs.one_video:
        return [(frame_file(source.frame or 0), source) for source in inputs.sources]
    if not video.is_dir():
        raise ImageError(f"{video}: is neither a video nor a folder with frames of one; name another input")
    if any(source.frame is not None for source in inputs.sources):
        raise ImageError(f"{video}: is a folder of videos; name one of them")
    names = [
        name if source.path.suffix.lower() in READ_BY_COLMAP else str(PurePath(name).with_suffix(".png"))
        for name, source in zip(inputs.names(), inputs.sources, strict=True)
    ]
    return list(zip(plain_names(names), inputs.sources, strict=True))


def refuse_few(video: Path, count: int) -> None:
    """Raise ImageError if a video has so few frames that they make no scene."""
    if count < MIN_FRAMES:
        frames = "1 frame" if count == 1 else f"{count} frames"
        raise ImageError(f"{video}: has {frames}, but a scene needs at least {MIN_FRAMES}")


def colmap_content(source: Source) -> bytes:
    """Return a frame's file as COLMAP reads it: of a video, and of what COLMAP does not read, a PNG."""
    if source.frame is not None or source.path.suffix.lower() in READ_BY_COLMAP:
        return source.picture()
    pixels = read_picture(source.path, as_stored=True).pixels
    return encode_png(pixels if pixels.dtype != np.float32 else np.rint(255 * pixels).astype(np.uint8))


def stored_size(source: Source) -> tuple[int, int]:
    """Return width and height of a frame as it is stored, pixels."""
    return read_picture(source.path, as_stored=True, content=source.read()).size


def plain_names(names: Sequence[str]) -> list[str]:
    """Return names of files that COLMAP's lists and JSON hold: white space and what is not Unicode become _.

    Of names that would be one, the later ones get a number.
    """
    taken = dict[str, None]()
    for name in names:
        plain = PurePath("".join("_" if mark.isspace() or not mark.isprintable() else mark for mark in name))
        more = (plain.with_name(f"{plain.stem}_{k}{plain.suffix}") for k in count(2))
        taken[next(str(one) for one in chain([plain], more) if str(one) not in taken)] = None
    return list(taken)


def looked_at(
    sources: Sequence[tuple[str, Source]], show: Callable[[int, int], None] = lambda done, count: None
) -> Iterator[Frame]:
    """Yield every frame with its sharpness and how far the picture moved; a video may end early."""
    before, window = None, None
    for place, (name, source) in enumerate(sources):
        show(place, len(sources))
        try:
            grey = _grey(source)
        except EndOfVideo as end:
            if end.whole and place:
                return
            raise
        thumbnail = np.asarray(_reduced(grey, THUMBNAIL_PX), np.float32)
        moved = 0.0
        if before is not None and before.shape == thumbnail.shape:
            window = (
                window if window is not None else cv2.createHanningWindow(thumbnail.shape[::-1], cv2.CV_32F)
            )
            shift = np.array(cv2.phaseCorrelate(before, thumbnail, window)[0])
            moved = float(np.linalg.norm(shift)) / max(thumbnail.shape)
        before = thumbnail
        yield Frame(name, place if source.frame is None else source.frame, gradient_energy(grey), moved)


def stood_still(images: Sequence[Path]) -> bool:
    """Return whether the camera that took these did not move, but for what moves by itself in a small part.

    False where that cannot be known, as of pictures with few corners.
    """
    greys = map(_grey_of_photograph, images)
    grey = next(greys)
    first, side = equalised(np.asarray(grey, np.float32)), max(grey.shape)
    corners = cv2.goodFeaturesToTrack(grey, CORNERS, 0.005, CORNERS_APART * side)
    if corners is None or len(corners) < FEWEST_CORNERS:
        return False
    for other in (equalised(np.asarray(grey, np.float32)) for grey in greys):
        if other.shape != first.shape:
            return False
        found, good, _ = cv2.calcOpticalFlowPyrLK(first, other, corners, np.empty_like(corners))
        near = np.linalg.norm(found - corners, axis=2) <= STILL_MOVE * side
        if np.mean(near & (good == 1)) < STILL_CORNERS:
            return False
    return True


def _grey(source: Source) -> AnyArray:
    if source.frame is not None:
        return np.asarray(cv2.cvtColor(read_frame(source.path, source.frame), cv2.COLOR_BGR2GRAY))
    return _grey_of_photograph(source.path)


def _grey_of_photograph(path: Path) -> AnyArray:
    levels = read_picture(path, as_stored=True).levels()
    return np.asarray(np.rint(255 * cv2.cvtColor(levels, cv2.COLOR_RGB2GRAY)), np.uint8)


def _reduced(grey: AnyArray, side: int) -> AnyArray:
    scale = min(1.0, side / max(grey.shape))
    return np.asarray(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))


def chosen(frames: Sequence[Frame], limit: int) -> list[Frame]:
    """Return the sharpest frame of each stretch, ``limit`` at most; a stretch is as far as the picture moves.

    Of few frames all are chosen. Where the picture hardly moves, stretches are of as many frames each.
    """
    way = np.cumsum([frame.moved for frame in frames])
    if len(frames) <= min(FEW, limit) and way[-1] > STRETCH:
        return list(frames)
    count = int(np.clip(way[-1] / STRETCH, min(FEWEST, len(frames)), min(limit, len(frames))))
    even = np.arange(len(frames)) / len(frames)
    along = way / way[-1] if way[-1] > STRETCH else even
    # a share by time, so that no pause is left without frames
    stretches = np.minimum((count * (0.8 * along + 0.2 * even)).astype(int), count - 1)
    best = dict[int, Frame]()
    for stretch, frame in zip(stretches.tolist(), frames, strict=True):
        if stretch not in best or frame.energy > best[stretch].energy:
            best[stretch] = frame
    return list(best.values())


def sharp_enough(names: Sequence[str], smear_px: Mapping[str, float | None]) -> list[list[str]]:
    """Return sets of chosen frames for COLMAP by smears: larger ones where one makes no good model.

    The last has all, and is the only one if the smears of most are long.
    """
    found = list[list[str]]()
    for longest_px in (*MAX_MAPPED_PX, np.inf):
        sharp = [name for name in names if (smear_px[name] or 0.0) <= longest_px]
        enough = len(sharp) >= max(MIN_FRAMES, MIN_SHARP * len(names)) or len(sharp) == len(names)
        if enough and sharp not in found:
            found.append(sharp)
    return found
