"""COLMAP's project of a steady walk: features and matches of its photographs, and models of them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import pycolmap

from blur2view.arrays import Array
from blur2view.camera import to_colmap
from blur2view.geometry.pose import rotation_matrix


@dataclass(frozen=True, kw_only=True)
class Walk:
    """A camera that turns by ``turn`` (3,) and moves by ``move`` (3,) a frame; its middle frame is at 0.

    Image k + 1 is that of frame k; with ``rig`` the camera is the second of a rig, and its frames have other
    ids than the images.
    """

    names: Sequence[str]
    size: tuple[int, int]
    focal: float
    turn: Array
    move: Array
    rig: bool = False

    def pose_at(self, time: float) -> Array:
        """Return cam_from_world (3, 4) at a time in frames."""
        time -= len(self.names) // 2
        R = rotation_matrix(self.turn * time)
        return np.column_stack([R, R @ (self.move * time)])

    def pixels(self, pose: Array, points: Array) -> Array:
        """Return our pixels (N, 2) of points (N, 3) of the world."""
        seen = points @ pose[:, :3].T + pose[:, 3]
        return np.asarray(self.focal * seen[:, :2] / seen[:, 2:] + (np.array(self.size) - 1) / 2)

    def write(self, points: Array, database: Path, models: Mapping[Path, Iterable[int]]) -> None:
        """Write a project that has these points (N, 3) for features, and models of some of the frames."""
        cameras, rig = self._cameras()
        images = [self._image(k, points) for k in range(len(self.names))]
        geometry = pycolmap.TwoViewGeometry()
        geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
        geometry.inlier_matches = np.arange(len(points), dtype=np.uint32)[:, None].repeat(2, axis=1)
        with pycolmap.Database.open(database) as opened:
            for camera in cameras:
                opened.write_camera(camera)
            opened.write_rig(rig)
            for image, frame in images:
                opened.write_image(image)
                opened.write_frame(frame, use_frame_id=True)
                keypoints = np.array([point.xy for point in image.points2D], np.float32)
                opened.write_keypoints(image.image_id, keypoints)
            for pair in combinations(range(1, len(images) + 1), 2):
                opened.write_matches(*pair, geometry.inlier_matches)
                opened.write_two_view_geometry(*pair, geometry)
        for folder, frames in models.items():
            folder.mkdir(parents=True)
            self._model(points, list(frames)).write(folder)

    def _model(self, points: Array, frames: Sequence[int]) -> pycolmap.Reconstruction:
        """Return a model of some frames, in which every point has a track."""
        model, (cameras, rig) = pycolmap.Reconstruction(), self._cameras()
        for camera in cameras:
            model.add_camera(camera)
        model.add_rig(rig)
        for k in frames:
            image, frame = self._image(k, points)
            image.frame_id = frame.frame_id
            model.add_frame(frame)
            model.add_image(image)
            pose = pycolmap.Rigid3d(self.pose_at(k))
            model.frame(frame.frame_id).set_cam_from_world(image.camera_id, pose)
            model.register_frame(frame.frame_id)
        for index, point in enumerate(points):
            track = pycolmap.Track()
            for k in frames:
                track.add_element(k + 1, index)
            model.add_point3D(point, track, np.array([index % 256, 100, 200], np.uint8))
        return model

    def _cameras(self) -> tuple[list[pycolmap.Camera], pycolmap.Rig]:
        """Return the rig and its cameras, of which the last takes the photographs."""
        (width, height), rig = self.size, pycolmap.Rig(rig_id=1)
        given = {"model": "SIMPLE_PINHOLE", "params": [self.focal, width / 2, height / 2]}
        cameras = [
            pycolmap.Camera(width=width, height=height, camera_id=number, **given)
            for number in range(1, 2 + self.rig)
        ]
        for camera in cameras:
            camera.has_prior_focal_length = True
        rig.add_ref_sensor(cameras[0].sensor_id)
        if self.rig:
            rig.add_sensor(cameras[1].sensor_id, pycolmap.Rigid3d(translation=[0.1, 0, 0]))
        return cameras, rig

    def _image(self, k: int, points: Array) -> tuple[pycolmap.Image, pycolmap.Frame]:
        """Return an image of points (N, 3), and the frame that it is alone in."""
        keypoints = to_colmap(self.pixels(self.pose_at(k), points))
        given = {"name": self.names[k], "image_id": k + 1, "camera_id": 1 + self.rig}
        image = pycolmap.Image(keypoints=keypoints, **given)
        frame = pycolmap.Frame(frame_id=k + 1 + 8 * self.rig, rig_id=1)
        frame.add_data_id(image.data_id)
        return image, frame
