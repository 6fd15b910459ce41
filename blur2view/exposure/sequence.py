"""The frames of a video as a series: every estimate in the direction of time that its neighbours show."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.camera import Camera
from blur2view.exposure.features import NO_FEATURES, Features, features_of, match_features
from blur2view.exposure.time_direction import NeighbourMotion, directed, neighbour_motion
from blur2view.exposure.views import ExposureViews, views_of
from blur2view.geometry.rolling_shutter import RollingShutter
from blur2view.images.video import read_video
from blur2view.networks.protocol import SmearReader
from blur2view.networks.smear_network import SmearNetwork, photograph_of, rgb_of
from blur2view.pipeline import Estimate, estimate
from blur2view.smears.matches import SelectOptions
from blur2view.two_view.estimate import EstimatorOptions


def in_time(estimated: Estimate, motions: Sequence[NeighbourMotion]) -> Estimate:
    """Return an estimate in the likelier direction of time, and whether neighbours decide it (``time``)."""
    views, candidates = views_of("frame", replace(estimated, shutter=None)), list[ExposureViews]()
    if estimated.shutter is not None:  # another motion in the other order in time, or none
        candidates = [views] if estimated.geometry.backward is None else [views, views.reversed()]
    views = directed(views, motions, candidates)
    return replace(estimated, geometry=views.geometry, time=views.time)


def estimate_frames(
    frames: Iterable[AnyArray] | str | os.PathLike[str],
    *,
    timestamps_s: Iterable[float] | None = None,
    network: SmearReader | None = None,
    select: SelectOptions | None = None,
    options: EstimatorOptions | None = None,
    camera: Camera | None = None,
    shutter: RollingShutter | None = None,
) -> Iterator[Estimate]:
    """Return an iterator over estimates of a video's frames, each in the right direction of time.

    Each is as of :func:`estimate`, given when the next frame is there: both neighbours decide the direction
    (``time``). ``frames``, of one size, are pictures (H, W, 3) or (H, W) in the order of time, or a video's
    file; ``timestamps_s``, as of `timestamps_of`, go with them. ValueError if they are one photograph, their
    sizes differ, or there are fewer times; else as `estimate`.

    Examples
    --------
    Rates of a robot's camera as its gyroscope shows them, for ROS's ``sensor_msgs/Imu``::

        paths = sorted(Path("mav0/cam0/data").glob("*.png"))
        stamps = blur2view.timestamps_of(paths)  # from the names
        images, camera = map(blur2view.read_image, paths), blur2view.Camera.from_focal(458.0, (752, 480))
        for one in blur2view.estimate_frames(images, timestamps_s=stamps, camera=camera):
            rate = one.angular_velocity(0.02)
            if rate is not None and one.time.known:  # it moved, shows a pose, and its sign is known
                publish(one.timestamp_s, rate.of_gyroscope.mean, rate.of_gyroscope.covariance)
    """
    network = network or SmearNetwork()
    one_of = partial(
        estimate, network=network, select=select, options=options, camera=camera, shutter=shutter
    )
    found = _in_series(map(photograph_of, _frames_of(frames)), one_of, camera)
    return found if timestamps_s is None else _timed(found, iter(timestamps_s))


def _frames_of(frames: object) -> Iterable[AnyArray]:
    """Return the frames of a video, which may be its file; ValueError of anything else."""
    if isinstance(frames, str | os.PathLike):
        if os.path.isdir(frames):
            raise ValueError(f"{frames}: is a folder; give map(blur2view.read_image, paths of its frames)")
        return read_video(frames)
    if isinstance(frames, np.ndarray) and frames.ndim < 4 or not isinstance(frames, Iterable):
        raise ValueError(f"expected the frames of a video, got {type(frames)}; of one call estimate(image)")
    return frames


def _in_series(
    frames: Iterable[AnyArray], estimate_one: Callable[[AnyArray], Estimate], camera: Camera | None
) -> Iterator[Estimate]:
    """Yield the estimate of each frame when the next one is there."""
    last: Estimate | None = None
    seen: list[NeighbourMotion] = []
    features: Features = NO_FEATURES
    for number, frame in enumerate(frames):
        one, before = estimate_one(frame), features
        features = features_of(rgb_of(frame))
        if last is not None:
            if one.grid.size != last.grid.size:
                raise ValueError(f"frame {number} has {one.grid.size} pixels, those before {last.grid.size}")
            earlier, later = match_features(before, features)
            yield in_time(last, [*seen, neighbour_motion(earlier, later, 1, camera)])
            seen = [neighbour_motion(later, earlier, -1, camera)]
        last = one
    if last is not None:
        yield in_time(last, seen)


def _timed(found: Iterable[Estimate], times: Iterator[float]) -> Iterator[Estimate]:
    """Yield estimates with their times; ValueError if there are fewer of these."""
    for one in found:
        if (time := next(times, None)) is None:
            raise ValueError("there are fewer timestamps than frames")
        yield replace(one, timestamp_s=float(time))
