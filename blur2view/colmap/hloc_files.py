"""hloc's files: ``features.h5``, ``matches.h5`` and ``pairs.txt``, as its extractors and matchers write them.

hloc (Hierarchical-Localization 1.5) keeps a group of datasets per image name in one HDF5 file, and one per
pair of names, "/" in them replaced by "-", in another. Its pixels are ours, (0, 0) at the centre of the first
one; it adds the half pixel itself when it fills a database. For that (``hloc.triangulation.import_features``
and ``import_matches``) a database must hold the views' names: ``hloc.reconstruction.import_images`` makes one
from the pictures of ``--format matches``.
"""

import os
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.colmap.database import inliers
from blur2view.colmap.text_formats import are_views, writing_views
from blur2view.errors import OutputError
from blur2view.exposure.views import ExposureViews
from blur2view.input_files import open_regular, read_regular
from blur2view.output_files import write_files

UNMATCHED = -1
DAMAGE = (OSError, RuntimeError, LookupError, ValueError, TypeError)  # what h5py raises of damaged bytes
NAMES = ("features.h5", "matches.h5", "pairs.txt")


def matches0(views: ExposureViews) -> NDArray[np.int32]:
    """Return for every keypoint of the open view, (N,), its keypoint of the close view, -1 for an outlier."""
    index = np.full(len(views.sigma_px), UNMATCHED, np.int32)
    index[inliers(views)] = inliers(views)
    return index


def certainty(views: ExposureViews) -> NDArray[np.float16]:
    """Return scores (N,) in (0, 1] that fall with sigma_px: 1 / (1 + sigma^2), half at one pixel."""
    return (1 / (1 + views.sigma_px**2)).astype(np.float16)


def write_hloc(folder: Path, sequence: Sequence[ExposureViews]) -> list[Path]:
    """Write and return ``features.h5``, ``matches.h5`` and ``pairs.txt``, each whole or not at all.

    The folder is created if needed; what an earlier call wrote there is replaced, see `refuse_foreign`. No
    name is there twice or has a blank, at which readers of pairs cut names.
    OutputError if h5py is missing, or a file cannot be written or is not ours.
    """
    h5py = _h5py()
    refuse_foreign(folder)
    paths = [folder / name for name in NAMES]
    with writing_views(folder):
        folder.mkdir(parents=True, exist_ok=True)
        # made in memory first: where a disk is full the library of HDF5 ends the process (h5py 3.16)
        features, matches = BytesIO(), BytesIO()
        for stream, add in ((features, _add_features), (matches, _add_matches)):
            with h5py.File(stream, "w") as file:
                for views in sequence:
                    add(file, views)
        pairs = "".join(" ".join(views.names) + "\n" for views in sequence).encode()
        write_files(dict(zip(paths, (features.getvalue(), matches.getvalue(), pairs), strict=True)))
    return paths


def refuse_foreign(folder: Path) -> None:
    """Raise an OutputError if files of these names hold more than views: hloc keeps its own in such files."""
    for name in NAMES:
        path = folder / name
        if os.path.lexists(path) and not _holds_views_alone(path):
            raise OutputError(
                f"{path}: holds more than views of an earlier call; choose another folder with -o"
            )


def _holds_views_alone(path: Path) -> bool:
    names: list[str] = []

    def note(name: str, node: Any) -> None:
        """Note the names of a group that holds what hloc puts there for an image, or a pair of them."""
        holds = {"keypoints": [name], "matches0": name.split("/")}
        if not hasattr(node, "keys"):  # a dataset; that of a group is noted with it
            names.extend([] if "/" in name else [name])
            return
        names.extend(part for key in node for part in holds.get(key, []))

    try:
        if path.suffix == ".txt":
            return are_views(read_regular(path).decode("utf-8", "replace").split())
        with open_regular(path) as opened, _h5py().File(opened, "r") as file:
            file.visititems(note)
    except DAMAGE:
        return False
    return are_views(names)


def _h5py() -> Any:
    try:
        import h5py
    except ImportError:
        raise OutputError("hloc's files need h5py; install it with: pip install h5py") from None
    return h5py


def _add_features(file: Any, views: ExposureViews) -> None:
    """Add the keypoints of both views, float32, with the standard deviation of a coordinate in pixels."""
    for name, points in zip(views.names, (views.points_open, views.points_close), strict=True):
        group = file.create_group(name)
        keypoints = group.create_dataset("keypoints", data=points.astype(np.float32))
        # sigma is that of the displacement in both directions: twice that of one coordinate of one end
        keypoints.attrs["uncertainty"] = float(np.median(views.sigma_px) / 2) if len(points) else 1.0
        group.create_dataset("scores", data=certainty(views))
        group.create_dataset("image_size", data=np.array(views.size))


def _add_matches(file: Any, views: ExposureViews) -> None:
    group = file.create_group("/".join(name.replace("/", "-") for name in views.names))
    matched = matches0(views)
    group.create_dataset("matches0", data=matched)
    scores = np.where(matched == UNMATCHED, np.float16(0), certainty(views))
    group.create_dataset("matching_scores0", data=scores)
