"""A model with exposures as gsplat's COLMAP reader takes it: its photographs alone, at mid exposure.

``examples/datasets/colmap.py`` of gsplat reads every image of the model in ``DIR/sparse/0`` and looks for its
file below ``DIR/images``, so that views, which no file has, end it; of cameras it knows `KNOWN`, and of masks
none for a single photograph. Every eighth photograph by name is held out. It knows no blur: a frame counts
as sharp at its mid exposure.
"""

from collections.abc import Collection
from pathlib import Path
from typing import Any

from blur2view.errors import DatabaseError

MODEL, PHOTOGRAPHS = Path("sparse", "0"), Path("images")  # below the folder that gsplat is given
KNOWN = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE")


def keep_photographs(model: Any, folder: Path, names: Collection[str]) -> None:
    """Remove all other images from the pycolmap.Reconstruction of a folder, and points that only they saw.

    DatabaseError if none of the names is registered, or a camera is of a kind that gsplat does not know.
    """
    posed = [image for image in model.images.values() if image.has_pose]
    kept = [image for image in posed if image.name in names]
    if not kept:
        raise DatabaseError(f"{folder}: has views alone and no pose of a photograph; name the model of both")
    for kind in sorted({model.cameras[image.camera_id].model_name for image in kept} - set(KNOWN)):
        raise DatabaseError(
            f"{folder}: has a camera {kind}, which gsplat does not know; undistort the photographs first "
            "with colmap image_undistorter"
        )
    for image in posed:
        if image.name not in names and image.has_pose:  # not with another of its frame
            model.deregister_frame(image.frame_id)
    model.tear_down()
