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
- Poses are ``cam2_from_cam1``: X2 = R X1 + t, t of unit length; a pose and its inverse are one answer.
- Thresholds named ``max_error_px`` are pixels; residuals and SErrMin are squared pixels.
- Decoded images are float32 (H, W, 3), RGB, sRGB-coded, in [0, 1].

The method follows "Robust Fundamental Matrix Estimation from Single Image Motion Blur" (Tran, Forssen,
Viksten), called "the paper" in this package.
"""

from blur2view.cameras import Camera
from blur2view.colmap_database import write_database
from blur2view.errors import (
    Blur2ViewError,
    CameraError,
    DatabaseError,
    ImageError,
    ModelError,
    OutputError,
)
from blur2view.exposure_views import ExposureViews, TimeDirection, views_of
from blur2view.image import read_image
from blur2view.matches import SelectOptions, SmearMatches, select_matches
from blur2view.motion_network import MotionNetwork
from blur2view.network_file import ModelInfo
from blur2view.pipeline import Estimate, Timings, estimate
from blur2view.pose import PoseCovariance, RigidTransform
from blur2view.predict import SmearNetwork, predict
from blur2view.segmentation import MotionLabel, MotionMask, MovingRegion, SegmentOptions, segment
from blur2view.smear import SmearField
from blur2view.tiles import TileOptions
from blur2view.two_view import Configuration, EstimatorOptions, TwoViewGeometry, estimate_two_view
from blur2view.viz import draw_overlay

__version__ = "0.1.0"

__all__ = [
    "Blur2ViewError",
    "Camera",
    "CameraError",
    "Configuration",
    "DatabaseError",
    "Estimate",
    "EstimatorOptions",
    "ExposureViews",
    "ImageError",
    "ModelError",
    "ModelInfo",
    "MotionLabel",
    "MotionMask",
    "MotionNetwork",
    "MovingRegion",
    "OutputError",
    "PoseCovariance",
    "RigidTransform",
    "SegmentOptions",
    "SelectOptions",
    "SmearField",
    "SmearMatches",
    "SmearNetwork",
    "TileOptions",
    "TimeDirection",
    "Timings",
    "TwoViewGeometry",
    "__version__",
    "draw_overlay",
    "estimate",
    "estimate_two_view",
    "predict",
    "read_image",
    "segment",
    "select_matches",
    "views_of",
    "write_database",
]
