"""The public names: read by type checkers, and by `blur2view` itself, which imports each when it is used."""

from blur2view.camera import Camera as Camera
from blur2view.colmap.database import write_database as write_database
from blur2view.colmap.mapping import blurred_options as blurred_options
from blur2view.colmap.mapping import global_options as global_options
from blur2view.colmap.mapping import mapper_options as mapper_options
from blur2view.colmap.placement import Placement as Placement
from blur2view.colmap.placement import place_views as place_views
from blur2view.colmap.project import camera_of_database as camera_of_database
from blur2view.colmap.recovery import RecoveredFrame as RecoveredFrame
from blur2view.colmap.recovery import Recovery as Recovery
from blur2view.colmap.recovery import recover_frames as recover_frames
from blur2view.errors import Blur2ViewError as Blur2ViewError
from blur2view.errors import CameraError as CameraError
from blur2view.errors import DatabaseError as DatabaseError
from blur2view.errors import ImageError as ImageError
from blur2view.errors import ModelError as ModelError
from blur2view.errors import OutputError as OutputError
from blur2view.exposure.sequence import estimate_frames as estimate_frames
from blur2view.exposure.views import ExposureViews as ExposureViews
from blur2view.exposure.views import views_of as views_of
from blur2view.geometry.pose import AngularVelocity as AngularVelocity
from blur2view.geometry.pose import PoseCovariance as PoseCovariance
from blur2view.geometry.pose import RigidTransform as RigidTransform
from blur2view.geometry.rolling_shutter import RollingShutter as RollingShutter
from blur2view.geometry.two_view_geometry import Configuration as Configuration
from blur2view.geometry.two_view_geometry import MotionModel as MotionModel
from blur2view.geometry.two_view_geometry import Parallax as Parallax
from blur2view.geometry.two_view_geometry import TimeDirection as TimeDirection
from blur2view.geometry.two_view_geometry import TwoViewGeometry as TwoViewGeometry
from blur2view.images.image import read_image as read_image
from blur2view.images.inputs import timestamps_of as timestamps_of
from blur2view.images.video import read_video as read_video
from blur2view.movers.mask import MotionLabel as MotionLabel
from blur2view.movers.mask import MotionMask as MotionMask
from blur2view.movers.mask import MovingRegion as MovingRegion
from blur2view.networks.smear_network import Detail as Detail
from blur2view.networks.smear_network import SmearNetwork as SmearNetwork
from blur2view.networks.smear_network import SmearReader as SmearReader
from blur2view.pipeline import Estimate as Estimate
from blur2view.pipeline import estimate as estimate
from blur2view.pipeline import segment as segment
from blur2view.results.overlay import draw_overlay as draw_overlay
from blur2view.smears.blur import Blur as Blur
from blur2view.smears.blur import BlurKind as BlurKind
from blur2view.smears.camera_motion import blur_of as blur_of
from blur2view.smears.grid import SmearField as SmearField
from blur2view.smears.grid import SmearGrid as SmearGrid
from blur2view.smears.grid import load_smears as load_smears
from blur2view.smears.matches import SelectOptions as SelectOptions
from blur2view.smears.matches import SmearMatches as SmearMatches
from blur2view.smears.matches import select_matches as select_matches
from blur2view.two_view.estimate import EstimatorOptions as EstimatorOptions
from blur2view.two_view.estimate import estimate_two_view as estimate_two_view

__version__: str
__all__: list[str]
