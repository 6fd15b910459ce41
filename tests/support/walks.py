"""COLMAP's project of a steady walk: features and matches of its photographs, and models of them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import pycolmap

from blur2view.arrays import Array
from blur2view.camera.colmap_camera import to_colmap
from blur2view.geometry.rotation import rotation_matrix


@dataclass(frozen=True, kw_only=True)
class Walk:
    """A camera that turns by ``turn`` (3,) and moves by ``move`` (3,) a frame; its middle frame is at 0."""

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
        pixels: Array = self.focal * seen[:, :2] / seen[:, 2:] + (np.array(self.size) - 1) / 2
        return pixels

    def write(self, points: Array, database: Path, models: Mapping[Path, Iterable[int]]) -> None:
        """Write a project that has these points (N, 3) for features, and models of some of the frames."""
        (width, height), numbers = self.size, range(1, len(self.names) + 1)
        params = [self.focal, width / 2, height / 2]
        camera = pycolmap.Camera(
            model="SIMPLE_PINHOLE", width=width, height=height, params=params, camera_id=1
        )
        camera.has_prior_focal_length = True
        poses = [self.pose_at(k) for k in range(len(self.names))]
        features = [to_colmap(self.pixels(pose, points)) for pose in poses]
        with pycolmap.Database.open(database) as opened:
            opened.write_camera(camera)
            for number, name, seen in zip(numbers, self.names, features, strict=True):
                opened.write_image(pycolmap.Image(name=name, camera_id=1))
                opened.write_keypoints(number, seen.astype(np.float32))
            geometry = pycolmap.TwoViewGeometry()
            geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
            geometry.inlier_matches = np.arange(len(points), dtype=np.uint32)[:, None].repeat(2, axis=1)
            for pair in combinations(numbers, 2):
                opened.write_matches(*pair, geometry.inlier_matches)
                opened.write_two_view_geometry(*pair, geometry)
        for folder, frames in models.items():
            model = pycolmap.Reconstruction()
            model.add_camera_with_trivial_rig(camera)
            for k in frames:
                image = pycolmap.Image(name=self.names[k], keypoints=features[k], camera_id=1, image_id=k + 1)
                pose = pycolmap.Rigid3d(pycolmap.Rotation3d(poses[k][:, :3]), poses[k][:, 3])
                model.add_image_with_trivial_frame(image, pose)
            for index, point in enumerate(points):
                track = pycolmap.Track()
                for k in frames:
                    track.add_element(k + 1, index)
                model.add_point3D(point, track, np.array([index, 100, 200], np.uint8))
            folder.mkdir(parents=True)
            model.write(folder)
