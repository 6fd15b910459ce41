"""By how much the camera turned during each exposure of a scene, from smears at points of known depth."""

from collections.abc import Iterable, Sequence

import numpy as np

from blur2view.camera import normalised_points
from blur2view.colmap.frame_sequence import FrameSequence
from blur2view.colmap.warped_view import projected
from blur2view.exposure.trajectory import PATH_REACH, CameraPath, ExposedFrame, turning


def turnings(sequence: FrameSequence, names: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return degrees and their standard deviation, by the names of posed frames.

    A frame that is far from all others, or sees few points, has none.
    """
    times = np.array([sequence.times[name] for name in names], float)
    path = CameraPath(times, np.stack([sequence.poses[name] for name in names]), PATH_REACH)
    found = dict[str, tuple[float, float]]()
    for name, time in zip(names, times.tolist(), strict=True):
        first, last = path.ends(time, 1.0)
        if name in sequence.recovered:  # whose motion is corrected by its neighbours' pictures
            angle, sigma = sequence.recovered[name].turning()
        elif np.isfinite([first, last]).all():
            points = sorted(sequence.observed_points(name))
            angle, sigma = turning(_exposed(sequence, name, points, time), last - first)
        else:
            continue
        if np.isfinite(sigma):
            found[name] = float(np.degrees(angle)), float(np.degrees(sigma))
    return found


def _exposed(sequence: FrameSequence, name: str, ids: Iterable[int], time: float) -> ExposedFrame:
    """Return the smears of a frame where it sees points of the model, by their ids."""
    view, world = sequence.view(name), sequence.world(ids)
    pixels = projected(view.camera, view.points(world))
    seen = np.all((pixels >= 0) & (pixels <= [view.camera.width - 1, view.camera.height - 1]), axis=1)
    pixels, depth = pixels[seen], view.points(world)[seen, 2]
    smears = view.smears(pixels)[0]
    ends = [normalised_points(view.camera, pixels + share * smears) for share in (-0.5, 0.5)]
    return ExposedFrame(
        time=time,
        rays=normalised_points(view.camera, pixels),
        displacement=ends[1] - ends[0],
        inverse_depth=1 / depth,
    )
