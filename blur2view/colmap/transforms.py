"""A model with exposures as ``transforms.json``: what trainers of radiance fields read for blurred frames.

A model as `place_views` gives it holds three poses of a photograph: at mid exposure (NAME), when the shutter
opened (NAME#open) and when it closed (NAME#close). The world is the model's, in its unit. In both dialects
``transform_matrix`` (4x4) is world_from_camera with OpenGL's camera axes: x right, y up, z backwards
(instant-ngp, ``colmap2nerf.py --keep_colmap_coords``; nerfstudio, ``process_data/colmap_utils.py``);
``w``, ``h``, ``fl_x``, ``cx``, ``k1`` ... are COLMAP's numbers, above the frames if all share a camera;
``file_path`` is relative to the folder of the file.

instant-ngp (``src/nerf_loader.cu``): the camera goes from ``transform_matrix_start`` to
``transform_matrix_end``. ``rolling_shutter`` [a, b, c, d] gives the time of a ray through (u, v) in [0, 1]^2
as a + b u + c v + d r, r random. ``sharpness`` is relative, here 1 / (1 + smear in pixels). A position p
becomes ``scale`` p + ``offset``; cameras are put as far from the median of the points as by
``colmap2nerf.py``, in its box (``aabb_scale``).

nerfstudio as forked for "Gaussian Splatting on the Move" (arXiv:2403.13327; SpectacularAI/3dgs-deblur,
``process_synthetic_inputs.py`` and ``combine.py``): ``camera_linear_velocity`` is (centre at the close -
centre at the open) / ``exposure_time``, ``camera_angular_velocity`` the rotation vector from the open to the
close camera over ``exposure_time``, both in the camera axes of ``transform_matrix``. Only velocity times
exposure time shows in a photograph, so that 1 s will do where the time is unknown. ``ply_file_path`` names
the model's points. The main line reads the same file and knows nothing of the motion.

gsplat reads COLMAP's model, of its photographs alone: ``examples/datasets/colmap.py`` reads every image of
the model in ``DIR/sparse/0`` and looks for its file below ``DIR/images``, so that views, which no file has,
end it; of cameras it knows `KNOWN`, of masks and of blur nothing.
"""

import os
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from blur2view.arrays import Array
from blur2view.colmap import DIALECTS, INSTANT_NGP
from blur2view.colmap.models import database_of, observed
from blur2view.colmap.project import smear_lengths
from blur2view.errors import DatabaseError
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.geometry.rotation import rotation_vector
from blur2view.output_files import SIGNED_BY

OPENGL: Array = np.diag([1.0, -1.0, -1.0, 1.0])  # camera axes of OpenGL in those of COLMAP
PLAIN = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
FISHEYE = ("SIMPLE_FISHEYE", "FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "OPENCV_FISHEYE")
GLOBAL_SHUTTER = [0, 0, 0, 1]
BOX, NERF_SCALE, MEAN_DISTANCE = 16, 0.33, 4.0  # colmap2nerf.py, nerf_loader.h, colmap2nerf.py
PLY_KEY, PLY = "ply_file_path", "sparse_pc.ply"  # where ns-process-data writes the points
KNOWN = (*PLAIN, "OPENCV_FISHEYE")  # to gsplat
RENAMED = {"f": ("fl_x", "fl_y"), "fx": ("fl_x",), "fy": ("fl_y",), "k": ("k1",)}


@dataclass(frozen=True, kw_only=True, eq=False)
class ExposedPhotograph:
    """A photograph of a model with the poses of its exposure, world_from_camera with OpenGL's camera axes."""

    name: str
    camera_id: int
    middle: Array  # (4, 4), at mid exposure
    ends: tuple[Array, Array] | None  # (4, 4) at shutter-open and shutter-close, None without views
    smear_px: float | None  # length of its smear; None where it is unknown


def with_views(model: Any, folder: Path, max_smear_px: float = np.inf) -> list[ExposedPhotograph]:
    """Return the photographs of a folder's pycolmap.Reconstruction, by name, of no longer smears.

    The length is that which the results of the photograph state, where the model names the database that has
    it, else the median of what the photograph observes. A bound leaves out those whose smears are unknown.
    DatabaseError if none is left, none has both views, or a name leads out of the folder of photographs.
    """
    images = {image.name: image for image in model.images.values() if image.has_pose}
    photographs, lengths = [], smear_lengths(database_of(folder) or folder)
    for name in sorted(name for name in images if not name.endswith((OPEN, CLOSE))):
        if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
            raise DatabaseError(f"{folder}: image {name} lies outside of the folder of images; rename it")
        first, last = (images.get(name + end) for end in (OPEN, CLOSE))
        ends, smear_px = None, None
        if first is not None and last is not None:
            ends = _world_from_camera(first), _world_from_camera(last)
            smear_px = lengths.get(name, _smear_px(model, images[name], first, last))
        photographs.append(
            ExposedPhotograph(
                name=name,
                camera_id=images[name].camera_id,
                middle=_world_from_camera(images[name]),
                ends=ends,
                smear_px=smear_px,
            )
        )
    if all(one.ends is None for one in photographs):
        raise DatabaseError(
            f"{folder}: no photograph has both its views, NAME{OPEN} and NAME{CLOSE}; put them there with "
            "blur2view place"
        )
    if np.isinf(max_smear_px):
        return photographs
    kept = [one for one in photographs if one.smear_px is not None and one.smear_px <= max_smear_px]
    if not kept:
        raise DatabaseError(f"{folder}: all smears are longer than {max_smear_px:g} px; add to --max-smear")
    return kept


def transforms(
    model: Any,
    folder: Path,
    *,
    dialect: str = INSTANT_NGP,
    images: str = "images",
    exposure_s: float = 1.0,
    max_smear_px: float = np.inf,
) -> dict[str, Any]:
    """Return the content of ``transforms.json``, of plain JSON types; the module says what they mean.

    Of the pycolmap.Reconstruction of a folder, with views as `place_views` gives it. ``images`` is the folder
    of the photographs as seen from that of the file; the exposure time, seconds, is of nerfstudio's dialect;
    photographs with a longer smear are left out. DatabaseError as of `with_views`, or if a camera is of a
    kind that these files cannot hold; ValueError of another dialect or time.
    """
    if dialect not in DIALECTS or not 0 < exposure_s < np.inf:
        raise ValueError(f"expected a dialect of {DIALECTS} and a positive time, got {dialect}, {exposure_s}")
    photographs = with_views(model, folder, max_smear_px)
    cameras = {one.camera_id: intrinsics(folder, model.cameras[one.camera_id]) for one in photographs}
    kinds = sorted({one["camera_model"] for one in cameras.values()})
    if len(kinds) > 1:
        raise DatabaseError(f"{folder}: has plain and fisheye cameras; undistort the photographs first")
    shared = next(iter(cameras.values())) if len(cameras) == 1 else {"camera_model": kinds[0]}
    frames = []
    for one in photographs:
        own = {} if len(cameras) == 1 else cameras[one.camera_id]
        path = os.path.join(images, one.name).replace(os.sep, "/")
        pose = {"transform_matrix": one.middle.tolist()}
        frames.append({"file_path": path, **own, **pose, **_motion(one, dialect, exposure_s)})
    whole: dict[str, Any] = {"exposure_time": exposure_s, "rolling_shutter_time": 0.0}
    whole |= {PLY_KEY: PLY} if model.points3D else {}
    return shared | (_box(model, photographs) if dialect == INSTANT_NGP else whole) | {"frames": frames}


def point_cloud(model: Any) -> bytes:
    """Return the points of a model with their colours as binary PLY, as `pycolmap` writes it, signed."""
    with TemporaryDirectory() as folder:
        model.export_PLY(os.path.join(folder, PLY))
        head, body = Path(folder, PLY).read_bytes().split(b"element", 1)
    return head + f"comment {SIGNED_BY}\nelement".encode() + body


def intrinsics(folder: Path, camera: Any) -> dict[str, Any]:
    """Return the keys that describe a pycolmap.Camera; DatabaseError if a reader does not know it."""
    _require_known(folder, camera, (*PLAIN, *FISHEYE))
    kind: dict[str, Any] = {"camera_model": "OPENCV"}
    lens = ("k1", "k2", "p1", "p2")
    if camera.model_name in FISHEYE:
        kind, lens = {"camera_model": "OPENCV_FISHEYE", "is_fisheye": True}, ("k1", "k2", "k3", "k4")
    values = {"w": camera.width, "h": camera.height}
    for name, value in zip(camera.params_info.split(", "), camera.params.tolist(), strict=True):
        values |= dict.fromkeys(RENAMED.get(name, (name,)), value)
    return kind | values | {name: 0.0 for name in lens if name not in values}


def _require_known(folder: Path, camera: Any, known: Collection[str]) -> None:
    """Raise DatabaseError of a camera of a kind that is not known."""
    if camera.model_name not in known:
        why = f"which this trainer does not know; its are {', '.join(known)}"
        remedy = "undistort the photographs first with colmap image_undistorter"
        raise DatabaseError(f"{folder}: has a camera {camera.model_name}, {why}; {remedy}")


def _world_from_camera(image: Any) -> Array:
    """Return the pose (4, 4) of a pycolmap.Image with OpenGL's camera axes."""
    return np.vstack([image.cam_from_world().inverse().matrix(), [0, 0, 0, 1]]) @ OPENGL


def _smear_px(model: Any, image: Any, first: Any, last: Any) -> float | None:
    """Return the median length of the smears of what an image observes, as both views' keypoints have them.

    Not between the poses of the views: `place_views` takes all exposures of a video to be equally long.
    """
    seen = [*observed(model, image)]
    if not seen or seen[-1] >= min(first.num_points2D(), last.num_points2D()):
        return None
    ends = [np.array([view.points2D[place].xy for place in seen]) for view in (first, last)]
    return float(np.median(np.linalg.norm(ends[1] - ends[0], axis=1)))


def _motion(one: ExposedPhotograph, dialect: str, exposure_s: float) -> dict[str, Any]:
    """Return what instant-ngp, or the fork of nerfstudio, reads of an exposure."""
    if one.ends is None:
        still = {f"camera_{kind}_velocity": [0.0] * 3 for kind in ("linear", "angular")}
        return {} if dialect == INSTANT_NGP else still
    first, last = one.ends
    if dialect == INSTANT_NGP:
        sharp = {} if one.smear_px is None else {"sharpness": 1 / (1 + one.smear_px)}
        return {**sharp, "transform_matrix_start": first.tolist(), "transform_matrix_end": last.tolist()}
    camera_from_world = one.middle[:3, :3].T
    linear = camera_from_world @ (last[:3, 3] - first[:3, 3]) / exposure_s
    angular = camera_from_world @ rotation_vector(last[:3, :3] @ first[:3, :3].T) / exposure_s
    return {"camera_linear_velocity": linear.tolist(), "camera_angular_velocity": angular.tolist()}


def _box(model: Any, photographs: list[ExposedPhotograph]) -> dict[str, Any]:
    """Return the shutter, where instant-ngp's box lies in the world, and which way is up."""
    centres = np.stack([one.middle[:3, 3] for one in photographs])
    points = np.array([point.xyz for point in model.points3D.values()]).reshape(-1, 3)
    middle = np.median(points if len(points) else centres, axis=0)
    distance = float(np.linalg.norm(centres - middle, axis=1).mean())
    scale = NERF_SCALE * MEAN_DISTANCE / distance if distance > 0 else NERF_SCALE
    up = np.mean([one.middle[:3, 1] for one in photographs], axis=0)
    place = {"aabb_scale": BOX, "scale": scale, "offset": (0.5 - scale * middle).tolist()}
    return {"rolling_shutter": GLOBAL_SHUTTER, **place, "up": up.tolist()}


def keep_photographs(model: Any, folder: Path, names: Collection[str]) -> None:
    """Remove all other images from the pycolmap.Reconstruction of a folder, and points that only they saw.

    DatabaseError if a camera is of a kind that gsplat does not know, or the model is damaged.
    """
    posed = [image for image in model.images.values() if image.has_pose]
    for image in posed:
        if image.name in names:
            _require_known(folder, model.cameras[image.camera_id], KNOWN)
    try:
        for image in posed:
            if image.name not in names and image.has_pose:  # not with another of its frame
                model.deregister_frame(image.frame_id)
    except IndexError:  # images see points that are not there
        raise DatabaseError(f"{folder}: its model lacks points that it names; let COLMAP write it") from None
    model.tear_down()
