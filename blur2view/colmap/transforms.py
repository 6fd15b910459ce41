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
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from copy import copy
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.colmap.models import DATABASE, noted, observed
from blur2view.colmap.project import smear_lengths
from blur2view.errors import DatabaseError
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.geometry.pose import rotation_vector
from blur2view.output import SIGNED_BY

INSTANT_NGP, NERFSTUDIO, GSPLAT = DIALECTS = ("instant-ngp", "nerfstudio", "gsplat")
OPENGL: Array = np.diag([1.0, -1.0, -1.0, 1.0])  # camera axes of OpenGL in those of COLMAP
PLAIN = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
FISHEYE = ("SIMPLE_FISHEYE", "FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "OPENCV_FISHEYE")
RENAMED = {"f": ("fl_x", "fl_y"), "fx": ("fl_x",), "fy": ("fl_y",), "k": ("k1",)}
GLOBAL_SHUTTER = [0, 0, 0, 1]
BOX, NERF_SCALE, MEAN_DISTANCE = 16, 0.33, 4.0  # colmap2nerf.py, nerf_loader.h, colmap2nerf.py
FRAME_KEYS, IMAGE_KEYS = ("frame_id", "rig_id", "rig_from_world"), ("name", "camera_id", "image_id")
PLY_KEY, PLY = "ply_file_path", "sparse_pc.ply"  # where ns-process-data writes the points


class Exposed(NamedTuple):
    """A photograph of a model."""

    image: Any  # pycolmap.Image
    views: tuple[Any, ...]  # at shutter-open and -close; empty unless the model has both
    smear_px: float | None  # length of its smear; None if unknown


def exposed_images(model: Any, folder: Path) -> list[Exposed]:
    """Return the photographs, by name, of a folder's pycolmap.Reconstruction.

    Lengths are those of the database that the model names, else medians over the points that a photograph
    observes. DatabaseError if no photograph has both views, or a name leads out of the folder of
    photographs.
    """
    images = {image.name: image for image in model.images.values() if image.has_pose}
    photographs, lengths = list[Exposed](), smear_lengths(noted(folder, DATABASE) or folder)
    for name in sorted(name for name in images if not name.endswith((OPEN, CLOSE))):
        if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
            raise DatabaseError(f"{folder}: image {name} lies outside of the folder of images; rename it")
        if name + OPEN in images and name + CLOSE in images:
            views = images[name + OPEN], images[name + CLOSE]
            smear_px = lengths.get(name, _smear_px(model, images[name], *views))
            photographs.append(Exposed(images[name], views, smear_px))
        else:
            photographs.append(Exposed(images[name], (), None))
    if not any(photograph.views for photograph in photographs):
        remedy = f"NAME{OPEN} and NAME{CLOSE}; put them there with blur2view place or recover --views"
        raise DatabaseError(f"{folder}: no photograph has both of its views, {remedy}")
    return photographs


def _smear_px(model: Any, image: Any, first: Any, last: Any) -> float | None:
    """Return the median length of observed smears by keypoints: poses of `place_views` are equally long."""
    seen = [*observed(model, image)]
    if not seen or seen[-1] >= min(first.num_points2D(), last.num_points2D()):
        return None
    ends = [np.array([view.points2D[index].xy for index in seen]) for view in (first, last)]
    return float(np.median(np.linalg.norm(ends[1] - ends[0], axis=1)))


def transforms_content(
    model: Any,
    folder: Path,
    photographs: Sequence[Exposed],
    *,
    dialect: str = INSTANT_NGP,
    images: str = "images",
    sizes: Mapping[str, tuple[int, int]] = MappingProxyType({}),
    exposure_s: float = 1.0,
) -> dict[str, Any]:
    """Return the content of ``transforms.json``, of plain JSON types; the module says what they mean.

    ``images`` is the folder of the photographs as seen from that of the file; ``sizes`` are those (width,
    height) of photographs by name, to which cameras are scaled, by default the cameras' own; the exposure
    time, seconds, is of nerfstudio's dialect. DatabaseError if these files cannot hold a camera of the model
    in ``folder``.
    """
    image_cameras = {image.name: (image.camera_id, sizes.get(image.name)) for image, _, _ in photographs}
    cameras = {
        (number, size): intrinsics(folder, scaled(model.cameras[number], size))
        for number, size in set(image_cameras.values())
    }
    kinds = sorted({keys["camera_model"] for keys in cameras.values()})
    if len(kinds) > 1:
        raise DatabaseError(f"{folder}: has plain and fisheye cameras; undistort the photographs first")
    shared = next(iter(cameras.values())) if len(cameras) == 1 else {"camera_model": kinds[0]}
    if dialect == INSTANT_NGP:
        content, motions = _box(model, photographs), [_ends(photograph) for photograph in photographs]
    else:
        content = {"exposure_time": exposure_s, "rolling_shutter_time": 0.0}
        content |= {PLY_KEY: PLY} if model.points3D else {}
        motions = [_velocities(photograph, exposure_s) for photograph in photographs]
    frames = []
    for (image, _, _), motion in zip(photographs, motions, strict=True):
        own = {} if len(cameras) == 1 else cameras[image_cameras[image.name]]
        path = os.path.join(images, image.name).replace(os.sep, "/")
        pose = {"transform_matrix": _world_from_camera(image).tolist()}
        frames.append({"file_path": path, **own, **pose, **motion})
    return {**shared, **content, "frames": frames}


def scaled(camera: Any, size: tuple[int, int] | None) -> Any:
    """Return a pycolmap.Camera for photographs of another size, or itself.

    ValueError if the size is that of a part of the picture: width or height is off by more than a pixel.
    """
    if size is None or size == (camera.width, camera.height):
        return camera
    if abs(size[0] * camera.height - size[1] * camera.width) > camera.width + camera.height:
        raise ValueError(f"its {size[0]}x{size[1]} pixels do not show all {camera.width}x{camera.height}")
    other = copy(camera)
    other.rescale(*size)
    return other


def intrinsics(folder: Path, camera: Any) -> dict[str, Any]:
    """Return the keys that describe a pycolmap.Camera; DatabaseError if a reader does not know it."""
    if camera.model_name not in (*PLAIN, *FISHEYE):
        why = f"which this trainer does not know; it knows {', '.join((*PLAIN, *FISHEYE))}"
        remedy = "undistort the photographs first with colmap image_undistorter"
        raise DatabaseError(f"{folder}: has a camera {camera.model_name}, {why}; {remedy}")
    kind: dict[str, Any] = {"camera_model": "OPENCV"}
    lens = ("k1", "k2", "p1", "p2")
    if camera.model_name in FISHEYE:
        kind, lens = {"camera_model": "OPENCV_FISHEYE", "is_fisheye": True}, ("k1", "k2", "k3", "k4")
    values = {"w": camera.width, "h": camera.height}
    for name, value in zip(camera.params_info.split(", "), camera.params.tolist(), strict=True):
        values |= dict.fromkeys(RENAMED.get(name, (name,)), value)
    return kind | values | {name: 0.0 for name in lens if name not in values}


def _world_from_camera(image: Any) -> Array:
    """Return the pose (4, 4) of a pycolmap.Image with OpenGL's camera axes."""
    return np.vstack([image.cam_from_world().inverse().matrix(), [0, 0, 0, 1]]) @ OPENGL


def _ends(photograph: Exposed) -> dict[str, Any]:
    """Return instant-ngp's keys of an exposure: sharpness and both ends' poses, as far as known."""
    sharp = {} if photograph.smear_px is None else {"sharpness": 1 / (1 + photograph.smear_px)}
    ends = zip(("transform_matrix_start", "transform_matrix_end"), photograph.views, strict=False)
    return sharp | {key: _world_from_camera(view).tolist() for key, view in ends}


def _velocities(photograph: Exposed, exposure_s: float) -> dict[str, Any]:
    """Return the keys of an exposure of nerfstudio's fork: velocities, zero without views."""
    linear = angular = np.zeros(3)
    if photograph.views:
        camera_from_world = _world_from_camera(photograph.image)[:3, :3].T
        first, last = map(_world_from_camera, photograph.views)
        linear = camera_from_world @ (last[:3, 3] - first[:3, 3]) / exposure_s
        angular = camera_from_world @ rotation_vector(last[:3, :3] @ first[:3, :3].T) / exposure_s
    return {"camera_linear_velocity": linear.tolist(), "camera_angular_velocity": angular.tolist()}


def _box(model: Any, photographs: Sequence[Exposed]) -> dict[str, Any]:
    """Return instant-ngp's keys of a scene: its shutter, where its box lies in the world, which way is up."""
    poses = np.stack([_world_from_camera(photograph.image) for photograph in photographs])
    centres = poses[:, :3, 3]
    points = np.array([point.xyz for point in model.points3D.values()]).reshape(-1, 3)
    middle = np.median(points if len(points) else centres, axis=0)
    distance = float(np.linalg.norm(centres - middle, axis=1).mean())
    scale = NERF_SCALE * MEAN_DISTANCE / distance if distance > 0 else NERF_SCALE
    up = poses[:, :3, 1].mean(axis=0)
    return {
        "rolling_shutter": GLOBAL_SHUTTER,
        "aabb_scale": BOX,
        "scale": scale,
        "offset": (0.5 - scale * middle).tolist(),
        "up": (up / max(float(np.linalg.norm(up)), TINY)).tolist(),
    }


def point_cloud(model: Any) -> bytes:
    """Return the points of a model with their colours as binary PLY, as `pycolmap` writes it, signed."""
    with TemporaryDirectory() as folder:
        model.export_PLY(os.path.join(folder, PLY))
        head, body = Path(folder, PLY).read_bytes().split(b"element", 1)
    return head + f"comment {SIGNED_BY}\nelement".encode() + body


def keep_photographs(model: Any, names: Collection[str]) -> Any:
    """Return a pycolmap.Reconstruction of some images, and of the points that two or more of them show.

    Ids stay. Of a rig an image goes, and not its frame, which holds all others of that instant.
    """
    import pycolmap

    kept, frames = pycolmap.Reconstruction(), defaultdict[int, list[Any]](list)
    for camera in model.cameras.values():
        kept.add_camera(camera)
    for rig in model.rigs.values():
        kept.add_rig(rig)
    for image in model.images.values():
        if image.name in names and image.has_pose:
            frames[image.frame_id].append(image)
    for images in frames.values():
        _copy_frame(images, kept)
    for number, point in model.points3D.items():
        shown = [element for element in point.track.elements if element.image_id in kept.images]
        if len(shown) > 1:
            same = {name: getattr(point, name) for name in ("xyz", "color", "error")}
            kept.add_point3D_with_id(number, pycolmap.Point3D(track=pycolmap.Track(shown), **same))
    return kept


def _copy_frame(images: Sequence[Any], model: Any) -> None:
    """Add images of one frame to a pycolmap.Reconstruction, with keypoints that show no points yet."""
    import pycolmap

    source_frame = images[0].frame
    frame = pycolmap.Frame(**{name: getattr(source_frame, name) for name in FRAME_KEYS})
    for image in images:
        frame.add_data_id(image.data_id)
    model.add_frame(frame)
    for image in images:
        keypoints = np.array([point.xy for point in image.points2D]).reshape(-1, 2)
        same = pycolmap.Image(keypoints=keypoints, **{name: getattr(image, name) for name in IMAGE_KEYS})
        same.frame_id = frame.frame_id
        model.add_image(same)
    model.register_frame(frame.frame_id)
