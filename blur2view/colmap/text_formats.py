"""COLMAP's text formats: keypoints for ``feature_importer``, matches for ``matches_importer``.

    colmap feature_importer --database_path new.db --image_path DIR/images --import_path DIR/keypoints
    colmap matches_importer --database_path new.db --match_list_path DIR/matches.txt --match_type inliers

(with ``--ImageReader.single_camera 1`` if one camera took all photographs). Both read names up to a blank.
Keypoints have a scale, an orientation and a SIFT descriptor, which views do not: 1, 0 and zeros stand for
them, so only these matches are of use. With ``--match_type inliers`` COLMAP takes the matches as they are;
F, E and the pose have no place in the text (COLMAP 3.8, with which this was checked, writes UNCALIBRATED and
a zero F). With ``raw`` it would verify them at 4 px, at which most exposures are a plane to it.
"""

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from blur2view.arrays import Array
from blur2view.camera.colmap_camera import to_colmap
from blur2view.colmap.database import inliers
from blur2view.errors import OutputError
from blur2view.exposure.views import CLOSE, OPEN, ExposureViews
from blur2view.input_files import read_regular
from blur2view.output_files import write_files
from blur2view.photographs.image import read_content
from blur2view.photographs.video import frame_of

DESCRIPTOR = " 0" * 128
NAMES = ("matches.txt", "keypoints", "images")


def keypoints_text(points: Array) -> str:
    """Return the text of keypoints (N, 2), our pixels: a line of counts, then x y scale orientation zeros."""
    rows = (f"{x:.6f} {y:.6f} 1 0{DESCRIPTOR}\n" for x, y in to_colmap(points))
    return f"{len(points)} 128\n" + "".join(rows)


def matches_text(views: ExposureViews) -> str:
    """Return the block of one photograph: both names, a line for each inlier, a blank line."""
    return " ".join(views.names) + "\n" + "".join(f"{k} {k}\n" for k in inliers(views)) + "\n"


def write_matches_text(
    folder: Path, sequence: Sequence[ExposureViews], photographs: Sequence[Path]
) -> list[Path]:
    """Write and return ``matches.txt`` and the folders ``keypoints``, of texts, and ``images``, of pictures.

    The folder is created if needed; what an earlier call wrote there is replaced, see `refuse_foreign`.
    No name is there twice or has a blank (`has_blank`), at which the formats cut names. COLMAP reads the size
    and EXIF of every image it imports, so each view gets a symbolic link to its photograph.
    OutputError if a file cannot be written or is not ours.
    """
    refuse_foreign(folder)
    matches, keypoints, images = paths = [folder / name for name in NAMES]
    with writing_views(folder):
        for views, photograph in zip(sequence, photographs, strict=True):
            for name, points in zip(views.names, (views.points_open, views.points_close), strict=True):
                _write(keypoints / f"{name}.txt", keypoints_text(points))
                _link(images / name, photograph)
        _remove_earlier((keypoints, images), {name for views in sequence for name in views.names})
        _write(matches, "".join(map(matches_text, sequence)))  # last: all that it names is there
    return paths


@contextmanager
def writing_views(folder: Path) -> Iterator[None]:
    """Raise what the system says of files that cannot be written as an OutputError, one line."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or " ".join(str(error).split())
        raise OutputError(f"{folder}: cannot be written ({reason}); choose another folder") from None


def has_blank(name: str) -> bool:
    """Return whether a name would be cut where it is written among others."""
    return any(character.isspace() for character in name)


def refuse_foreign(folder: Path) -> None:
    """Raise an OutputError for a folder with a ``matches.txt`` that has more than views."""
    path = folder / "matches.txt"
    if not os.path.lexists(path):
        return
    try:
        words = read_regular(path).decode("utf-8", "replace").split()
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be read ({error.strerror}); choose another folder with -o"
        ) from None
    if not are_views([word for word in words if not word.isdecimal()]):
        raise OutputError(f"{path}: holds more than views of an earlier call; choose another folder with -o")


def are_views(names: Sequence[str]) -> bool:
    """Return whether all of these names of images are those of views."""
    return all(name.endswith((OPEN, CLOSE)) for name in names)


def _remove_earlier(folders: Sequence[Path], names: set[str]) -> None:
    """Remove the views of an earlier call; a file that is not named like a view stays."""
    for folder in folders:
        for path in folder.glob("**/*#*"):
            name = path.relative_to(folder).as_posix().removesuffix(".txt")
            if name.endswith((OPEN, CLOSE)) and name not in names:
                path.unlink()


def _write(path: Path, text: str) -> None:
    """Write a text, whole or not at all, and the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_files({path: text.encode()})


def _link(path: Path, photograph: Path) -> None:
    """Link a photograph under another name; copy a frame, and where the file system has no links."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    if frame_of(photograph) is not None:
        path.write_bytes(read_content(photograph))
        return
    try:
        path.symlink_to(photograph.resolve())
    except OSError:
        shutil.copyfile(photograph, path)
