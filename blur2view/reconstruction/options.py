"""What a scene is made by."""

from dataclasses import dataclass

from blur2view.camera import Camera
from blur2view.errors import CameraError

CAMERA_MODELS = ("SIMPLE_RADIAL", "SIMPLE_PINHOLE", "PINHOLE", "RADIAL", "OPENCV")
MAPPERS = ("incremental", "global")
DIALECTS = ("nerfstudio", "instant-ngp")  # of `colmap.transforms`, those that read images beside the model
MIN_FRAMES = 3  # of a scene


@dataclass(frozen=True, kw_only=True)
class ReconstructionOptions:
    """What a scene is made by; equal options and video make equal scenes.

    ValueError for a camera model with a fisheye's distortion, for another mapper or dialect than are there,
    and for fewer than three frames; CameraError for a camera that is not one of COLMAP's, or a fisheye.
    """

    frames: int = 300  # that are chosen, at most, as by ns-process-data
    all_frames: bool = False  # whether the frames that are not chosen are recovered, too
    camera_model: str = CAMERA_MODELS[0]
    camera: str = ""  # "MODEL WIDTH HEIGHT PARAMS...", scaled to the frames' size; empty if unknown
    mapper: str = MAPPERS[0]
    dialect: str = DIALECTS[0]
    exposure_s: float = 1.0  # for nerfstudio's velocities
    masks: bool = True  # of what moves by itself, where anything does

    def __post_init__(self) -> None:
        if self.camera_model not in CAMERA_MODELS:
            raise ValueError(
                f"the camera model must be one of {', '.join(CAMERA_MODELS)}, because fisheye lenses are not "
                f"supported"
            )
        if self.mapper not in MAPPERS or self.dialect not in DIALECTS:
            raise ValueError(
                "mapper must be incremental or global, and dialect must be nerfstudio or instant-ngp"
            )
        if self.frames < MIN_FRAMES:
            raise ValueError(f"a scene needs at least {MIN_FRAMES} frames, got {self.frames}")
        if self.camera and "FISHEYE" in (model := Camera.from_string(self.camera).model):
            raise CameraError(f"camera {model}: fisheye lenses are not supported; undistort the frames first")

    def for_colmap(self, image_size: tuple[int, int]) -> tuple[str, str]:
        """Return COLMAP's camera model and its parameters for frames of (width, height), empty if unknown.

        CameraError if the camera is for pictures of another shape.
        """
        if not self.camera:
            return self.camera_model, ""
        camera = Camera.from_string(self.camera).for_image(image_size)
        return camera.model, ",".join(map(repr, camera.params))
