"""COLMAP's project of a steady walk: features and matches of its photographs, and models of them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pycolmap

from blur2view.arrays import AnyArray, Array
from blur2view.camera import to_colmap
from blur2view.geometry.pose import rotation_matrix


class Shot(NamedTuple):
    """A photograph: number, name, cam_from_world (3, 4), our pixels (N, 2), and which points they show."""

    number: int
    name: str
    pose: Array
    pixels: Array
    shown: AnyArray


def model_of(camera: pycolmap.Camera, points: Array, shots: Sequence[Shot]) -> pycolmap.Reconstruction:
    """Return a model of photographs and of the points (N, 3) that they show, which have tracks."""
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(camera)
    seen = np.unique(np.concatenate([shot.shown for shot in shots]))
    numbers = {k: model.add_point3D(points[k], pycolmap.Track()) for k in seen}
    for shot in shots:
        given = {"name": shot.name, "camera_id": camera.camera_id, "image_id": shot.number}
        image = pycolmap.Image(keypoints=to_colmap(shot.pixels), **given)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(shot.pose))
        for place, index in enumerate(shot.shown):
            model.add_observation(numbers[index], pycolmap.TrackElement(shot.number, place))
    return model


@dataclass(frozen=True, kw_only=True)
class Walk:
    """A camera that turns by ``turn`` (3,) and moves by ``move`` (3,) a frame; its middle frame is at 0.

    Image k + 1 is that of frame k.
    """

    names: Sequence[str]
    size: tuple[int, int]
    focal: float
    turn: Array
    move: Array

    def pose_at(self, time: float) -> Array:
        """Return cam_from_world (3, 4) at a time in frames."""
        time -= len(self.names) // 2
        R = rotation_matrix(self.turn * time)
        return np.column_stack([R, R @ (self.move * time)])

    def pixels(self, pose: Array, points: Array) -> Array:
        """Return our pixels (N, 2) of points (N, 3) of the world."""
        seen = points @ pose[:, :3].T + pose[:, 3]
        return np.asarray(self.focal * seen[:, :2] / seen[:, 2:] + (np.array(self.size) - 1) / 2)

    def write(
        self,
        points: Array,
        database: Path,
        models: Mapping[Path, Iterable[int]],
        times: Sequence[float] | None = None,
    ) -> None:
        """Write a project that has these points (N, 3) for features, and models of some of the frames."""
        (width, height), every = self.size, np.arange(len(points))
        params = [self.focal, width / 2, height / 2]
        camera = pycolmap.Camera(
            model="SIMPLE_PINHOLE", width=width, height=height, params=params, camera_id=1
        )
        camera.has_prior_focal_length = True
        poses = [self.pose_at(time) for time in times or range(len(self.names))]
        shots = [
            Shot(k + 1, self.names[k], pose, self.pixels(pose, points), every) for k, pose in enumerate(poses)
        ]
        write_database(database, model_of(camera, points, shots))
        for folder, frames in models.items():
            folder.mkdir(parents=True)
            model_of(camera, points, [shots[k] for k in frames]).write(folder)


def on_plane(pose: Array, rays: Array, normal: Array, distance: float) -> Array:
    """Return where rays (N, 3) of a camera meet the plane of points x with normal . x = distance, (N, 3)."""
    rays, centre = rays @ pose[:, :3], -pose[:, :3].T @ pose[:, 3]
    return np.asarray(centre + rays * ((distance - normal @ centre) / (rays @ normal))[:, None])


def write_database(path: Path, model: pycolmap.Reconstruction) -> None:
    """Write the features of a model's images, six columns as SIFT's; each matches its own in all others."""
    geometry = pycolmap.TwoViewGeometry()
    geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
    with pycolmap.Database.open(path) as database:
        for camera in model.cameras.values():
            database.write_camera(camera)
        for rig in model.rigs.values():
            database.write_rig(rig)
        for image in model.images.values():
            database.write_frame(model.frame(image.frame_id), use_frame_id=True)
            database.write_image(image, use_image_id=True)
            keypoints = np.array([[*point.xy, 1, 0, 0, 1] for point in image.points2D], np.float32)
            database.write_keypoints(image.image_id, keypoints)
        geometry.inlier_matches = np.arange(len(keypoints), dtype=np.uint32)[:, None].repeat(2, axis=1)
        for pair in combinations(sorted(model.images), 2):
            database.write_matches(*pair, geometry.inlier_matches)
            database.write_two_view_geometry(*pair, geometry)
