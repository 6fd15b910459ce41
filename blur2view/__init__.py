"""blur2view: one motion-blurred photograph in, the two-view geometry of the camera's motion out.

Conventions, used everywhere
----------------------------
- Image points are (x, y), float64, in pixels; (0, 0) is the centre of the top-left pixel (OpenCV).
- A smear is the full displacement d = end - start in pixels of a scene point during the exposure,
  defined up to sign, at the mid-exposure pixel p. Its ends are p - d/2 and p + d/2; their order in
  time is unknown. (The paper's s is d/2.)
- Double angle: d -> |d| (cos 2phi, sin 2phi), the same for d and -d. Fields are resized, averaged,
  blended and tiled in double angle only, and decoded last.
- F: ``points2^T F points1 = 0`` with 1 = shutter open, 2 = shutter close, ||F|| = 1. Which end of time
  is which stays open for the whole image: F and its transpose are one answer.
- Poses are ``cam2_from_cam1``: X2 = R X1 + t, t of unit length or, where parallax is not
  proven, zero; a pose and its inverse are one answer (with a rolling shutter: the two of ``reversed()``).
- Thresholds named ``max_error_px`` are pixels; residuals and SErrMin are squared pixels.
- Decoded images are float32 (H, W, 3), RGB, sRGB-coded, in [0, 1].

First calls
-----------
- ``found = estimate(read_image("a.jpg"))``: smears, matches and ``found.geometry``, with F or None, the
  configuration, its reason and ``parallax``; with ``camera=Camera.from_focal(focal, (width, height))`` E and
  the pose.
- ``found.geometry.to_pycolmap()``: the same as a pycolmap.TwoViewGeometry.
- ``segment(found, image)``: what moves by itself, as `blur2view segment` has it.
- ``load_smears("out/a.smear.npz").at_pixels()``: the smears that `blur2view estimate -o` has written.
- ``write_database(Path("new.db"), [views_of("a.jpg", found)])``: what `blur2view to-colmap` writes.
- ``SmearMatches.from_points(points1, points2)``: matches of unknown order from elsewhere.

The method follows "Robust Fundamental Matrix Estimation from Single Image Motion Blur" (Tran, Forssen,
Viksten), called "the paper" in this package.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # for type checkers, to which `as` says that a name is public
    from blur2view.camera.camera import Camera as Camera
    from blur2view.camera.image import read_image as read_image
    from blur2view.colmap.cameras import camera_of_database as camera_of_database
    from blur2view.colmap.database import write_database as write_database
    from blur2view.colmap.mapping import global_options as global_options
    from blur2view.colmap.mapping import mapper_options as mapper_options
    from blur2view.colmap.mapping import triangulate_exposure as triangulate_exposure
    from blur2view.colmap.placement import Placement as Placement
    from blur2view.colmap.placement import place_views as place_views
    from blur2view.errors import Blur2ViewError as Blur2ViewError
    from blur2view.errors import CameraError as CameraError
    from blur2view.errors import DatabaseError as DatabaseError
    from blur2view.errors import ImageError as ImageError
    from blur2view.errors import ModelError as ModelError
    from blur2view.errors import OutputError as OutputError
    from blur2view.exposure.views import ExposureViews as ExposureViews
    from blur2view.exposure.views import TimeDirection as TimeDirection
    from blur2view.exposure.views import views_of as views_of
    from blur2view.geometry.pose import PoseCovariance as PoseCovariance
    from blur2view.geometry.pose import RigidTransform as RigidTransform
    from blur2view.geometry.rolling_shutter import RollingShutter as RollingShutter
    from blur2view.geometry.two_view_geometry import Configuration as Configuration
    from blur2view.geometry.two_view_geometry import MotionModel as MotionModel
    from blur2view.geometry.two_view_geometry import Parallax as Parallax
    from blur2view.geometry.two_view_geometry import TwoViewGeometry as TwoViewGeometry
    from blur2view.networks.model_file import ModelInfo as ModelInfo
    from blur2view.networks.octaves import PyramidOptions as PyramidOptions
    from blur2view.networks.smear_network import SmearNetwork as SmearNetwork
    from blur2view.networks.smear_network import predict as predict
    from blur2view.networks.tiles import TileOptions as TileOptions
    from blur2view.pipeline import Estimate as Estimate
    from blur2view.pipeline import Timings as Timings
    from blur2view.pipeline import estimate as estimate
    from blur2view.segmentation.mask import MotionLabel as MotionLabel
    from blur2view.segmentation.mask import MotionMask as MotionMask
    from blur2view.segmentation.mask import MovingRegion as MovingRegion
    from blur2view.segmentation.mask import SegmentOptions as SegmentOptions
    from blur2view.segmentation.mask import segment as segment
    from blur2view.smears.field import SmearField as SmearField
    from blur2view.smears.grid import SmearGrid as SmearGrid
    from blur2view.smears.matches import SmearMatches as SmearMatches
    from blur2view.smears.sampling import SelectOptions as SelectOptions
    from blur2view.smears.sampling import select_matches as select_matches
    from blur2view.smears.stored import StoredSmears as StoredSmears
    from blur2view.smears.stored import load_smears as load_smears
    from blur2view.two_view.estimate import estimate_two_view as estimate_two_view
    from blur2view.two_view.options import EstimatorOptions as EstimatorOptions
    from blur2view.visualization.overlay import draw_overlay as draw_overlay

__version__ = "0.1.0"

_PUBLIC = {
    "camera.camera": ("Camera",),
    "camera.image": ("read_image",),
    "colmap.cameras": ("camera_of_database",),
    "colmap.database": ("write_database",),
    "colmap.mapping": ("global_options", "mapper_options", "triangulate_exposure"),
    "colmap.placement": ("Placement", "place_views"),
    "errors": ("Blur2ViewError", "CameraError", "DatabaseError", "ImageError", "ModelError", "OutputError"),
    "exposure.views": ("ExposureViews", "TimeDirection", "views_of"),
    "geometry.pose": ("PoseCovariance", "RigidTransform"),
    "geometry.rolling_shutter": ("RollingShutter",),
    "geometry.two_view_geometry": ("Configuration", "MotionModel", "Parallax", "TwoViewGeometry"),
    "networks.model_file": ("ModelInfo",),
    "networks.octaves": ("PyramidOptions",),
    "networks.smear_network": ("SmearNetwork", "predict"),
    "networks.tiles": ("TileOptions",),
    "pipeline": ("Estimate", "Timings", "estimate"),
    "segmentation.mask": ("MotionLabel", "MotionMask", "MovingRegion", "SegmentOptions", "segment"),
    "smears.field": ("SmearField",),
    "smears.matches": ("SmearMatches",),
    "smears.grid": ("SmearGrid",),
    "smears.sampling": ("SelectOptions", "select_matches"),
    "smears.stored": ("StoredSmears", "load_smears"),
    "two_view.estimate": ("estimate_two_view",),
    "two_view.options": ("EstimatorOptions",),
    "visualization.overlay": ("draw_overlay",),
}
_MODULE_OF = {name: module for module, names in _PUBLIC.items() for name in names}
__all__ = ["__version__", *sorted(_MODULE_OF)]


def __getattr__(name: str) -> Any:
    """Return a public name, imported when it is first used: `import blur2view` alone loads nothing."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names, also those that are not loaded yet."""
    return sorted({*globals(), *__all__})
