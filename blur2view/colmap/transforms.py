"""A model with exposures as ``transforms.json``: what trainers of radiance fields read for blurred frames.

A model as `place_views` gives it holds three poses of a photograph: at mid exposure (NAME), when the shutter
opened (NAME#open) and when it closed (NAME#close). In both dialects ``transform_matrix`` (4x4) is
world_from_camera with OpenGL's camera axes, x right, y up, z backwards (``colmap2nerf.py
--keep_colmap_coords``, nerfstudio's ``process_data/colmap_utils.py``), in the model's world; intrinsics are
COLMAP's numbers, above the frames if all share a camera.

instant-ngp (``src/nerf_loader.cu``): the camera goes from ``transform_matrix_start`` to
``transform_matrix_end``. ``rolling_shutter`` [a, b, c, d] gives the time of a ray through (u, v) in [0, 1]^2
as a + b u + c v + d r, r random. ``sharpness`` is 1 / (1 + smear in pixels). A position p becomes ``scale``
p + ``offset``, as in ``colmap2nerf.py``, in its box (``aabb_scale``).

nerfstudio as forked for "Gaussian Splatting on the Move" (arXiv:2403.13327; SpectacularAI/3dgs-deblur):
``camera_linear_velocity`` is (centre at the close - centre at the open) / ``exposure_time``,
``camera_angular_velocity`` the rotation vector from the open to the close camera over it, in the camera axes
of ``transform_matrix``. Only velocity times time shows in a photograph: 1 s will do where it is unknown.

gsplat reads COLMAP's model: ``examples/datasets/colmap.py`` reads every image of ``DIR/sparse/0`` and looks
for its file below ``DIR/images``, so that views, which no file has, end it.
"""

import os
from collections.abc import Collection
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.colmap import DIALECTS, INSTANT_NGP
from blur2view.colmap.models import DATABASE, noted, observed
from blur2view.colmap.project import smear_lengths
from blur2view.errors import DatabaseError
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.files import SIGNED_BY
from blur2view.geometry.pose import rotation_vector

OPENGL: Array = np.diag([1.0, -1.0, -1.0, 1.0])  # camera axes of OpenGL in those of COLMAP
PLAIN = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
FISHEYE = ("SIMPLE_FISHEYE", "FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "OPENCV_FISHEYE")
GLOBAL_SHUTTER = [0, 0, 0, 1]
BOX, NERF_SCALE, MEAN_DISTANCE = 16, 0.33, 4.0  # colmap2nerf.py, nerf_loader.h, colmap2nerf.py
PLY_KEY, PLY = "ply_file_path", "sparse_pc.ply"  # where ns-process-data writes the points
Exposed = tuple[Any, list[Any], float | None]
"""An image, its views at shutter-open and -close or none, and the length of its smear if it is known."""
KNOWN = (*PLAIN, "OPENCV_FISHEYE")  # to gsplat
RENAMED = {"f": ("fl_x", "fl_y"), "fx": ("fl_x",), "fy": ("fl_y",), "k": ("k1",)}


def with_views(model: Any, folder: Path, max_smear_px: float = np.inf) -> list[Exposed]:
    """Return the photographs of a folder's pycolmap.Reconstruction, by name, of no longer smears.

    Of the lengths of the database that the model names, else medians of what photographs observe.
    DatabaseError if none is left, none has both views, or a name leads out of the folder of photographs.
    """
    images = {image.name: image for image in model.images.values() if image.has_pose}
    photographs, lengths = list[Exposed](), smear_lengths(noted(folder, DATABASE) or folder)
    for name in sorted(name for name in images if not name.endswith((OPEN, CLOSE))):
        if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
            raise DatabaseError(f"{folder}: image {name} lies outside of the folder of images; rename it")
        views = [images[name + end] for end in (OPEN, CLOSE) if name + end in images]
        if len(views) == 2:
            smear_px = lengths.get(name, _smear_px(model, images[name], *views))
            photographs.append((images[name], views, smear_px))
        else:
            photographs.append((images[name], [], None))
    if not any(views for _, views, _ in photographs):
        raise DatabaseError(
            f"{folder}: no photograph has both its views, NAME{OPEN} and NAME{CLOSE}; put them there with "
            "blur2view place"
        )
    if np.isinf(max_smear_px):
        return photographs
    kept = [one for one in photographs if one[2] is not None and one[2] <= max_smear_px]
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

    ``images`` is the folder of the photographs as seen from that of the file; the exposure time, seconds, is
    of nerfstudio's dialect. DatabaseError as of `with_views`, or of cameras that these files cannot hold;
    ValueError of another dialect or time.
    """
    if dialect not in DIALECTS or not 0 < exposure_s < np.inf:
        raise ValueError(f"expected a dialect of {DIALECTS} and a positive time, got {dialect}, {exposure_s}")
    photographs = with_views(model, folder, max_smear_px)
    used = {image.camera_id for image, _, _ in photographs}
    cameras = {number: intrinsics(folder, model.cameras[number]) for number in used}
    kinds = sorted({one["camera_model"] for one in cameras.values()})
    if len(kinds) > 1:
        raise DatabaseError(f"{folder}: has plain and fisheye cameras; undistort the photographs first")
    shared = next(iter(cameras.values())) if len(cameras) == 1 else {"camera_model": kinds[0]}
    frames = []
    for image, views, smear_px in photographs:
        own = {} if len(cameras) == 1 else cameras[image.camera_id]
        path = os.path.join(images, image.name).replace(os.sep, "/")
        middle = _world_from_camera(image)
        ends = [_world_from_camera(view) for view in views]
        motion = _ends(ends, smear_px) if dialect == INSTANT_NGP else _velocities(middle, ends, exposure_s)
        frames.append({"file_path": path, **own, "transform_matrix": middle.tolist(), **motion})
    whole: dict[str, Any] = {"exposure_time": exposure_s, "rolling_shutter_time": 0.0}
    whole |= {PLY_KEY: PLY} if model.points3D else {}
    return (
        shared
        | (_box(model, [image for image, _, _ in photographs]) if dialect == INSTANT_NGP else whole)
        | {"frames": frames}
    )


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
    """Return the median length of observed smears by keypoints: poses of `place_views` are equally long."""
    seen = [*observed(model, image)]
    if not seen or seen[-1] >= min(first.num_points2D(), last.num_points2D()):
        return None
    ends = [np.array([view.points2D[place].xy for place in seen]) for view in (first, last)]
    return float(np.median(np.linalg.norm(ends[1] - ends[0], axis=1)))


def _ends(ends: list[Array], smear_px: float | None) -> dict[str, Any]:
    """Return what instant-ngp reads of an exposure."""
    sharp = {} if smear_px is None else {"sharpness": 1 / (1 + smear_px)}
    named = zip(("transform_matrix_start", "transform_matrix_end"), ends, strict=False)
    return sharp | {name: end.tolist() for name, end in named}


def _velocities(middle: Array, ends: list[Array], exposure_s: float) -> dict[str, Any]:
    """Return what the fork of nerfstudio reads of an exposure."""
    linear = angular = np.zeros(3)
    if ends:
        first, last = ends
        linear = middle[:3, :3].T @ (last[:3, 3] - first[:3, 3]) / exposure_s
        angular = middle[:3, :3].T @ rotation_vector(last[:3, :3] @ first[:3, :3].T) / exposure_s
    return {"camera_linear_velocity": linear.tolist(), "camera_angular_velocity": angular.tolist()}


def _box(model: Any, images: list[Any]) -> dict[str, Any]:
    """Return the shutter, where instant-ngp's box lies in the world, and which way is up."""
    poses = np.stack([_world_from_camera(image) for image in images])
    centres = poses[:, :3, 3]
    points = np.array([point.xyz for point in model.points3D.values()]).reshape(-1, 3)
    middle = np.median(points if len(points) else centres, axis=0)
    distance = float(np.linalg.norm(centres - middle, axis=1).mean())
    scale = NERF_SCALE * MEAN_DISTANCE / distance if distance > 0 else NERF_SCALE
    up = poses[:, :3, 1].mean(axis=0)
    place = {"aabb_scale": BOX, "scale": scale, "offset": (0.5 - scale * middle).tolist()}
    return {
        "rolling_shutter": GLOBAL_SHUTTER,
        **place,
        "up": (up / max(float(np.linalg.norm(up)), TINY)).tolist(),
    }


def keep_photographs(model: Any, folder: Path, names: Collection[str]) -> None:
    """Remove all other images and their points; DatabaseError of a camera that gsplat does not know."""
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
