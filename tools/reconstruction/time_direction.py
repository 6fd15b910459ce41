"""How often neighbours decide the time direction, and rotations within exposures beside those of the poses.

    python -m tools.reconstruction.sequence render/sequence --photos KODAK
    python -m tools.reconstruction.time_direction --rendered render/sequence \
        --redkitchen ../shared/data/redkitchen_sequence --out tools/results/time_direction

estimates every frame with the shipped network and the true intrinsics, lets neighbours vote with the matches
that OpenCV finds between the blurred photographs, and writes a table (``.md``) and the rotation vectors over
time (``.png``). Right is a frame whose inlier smears, open to close, go with the true motion there (mean
cosine above zero). Rotations are compared after one scale for the whole video, that of the medians of their
lengths: the share of the time from frame to frame during which RedKitchen's shutter is open is not known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import blur2view
from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.camera.colmap_camera import to_colmap
from blur2view.exposure.neighbours import PhotographMatcher
from blur2view.exposure.time_direction import with_time_direction
from blur2view.exposure.views import ExposureViews, views_of
from blur2view.geometry.epipolar import homogeneous
from blur2view.geometry.rotation import rotation_vector
from tools.arguments import existing, parser_of, target
from tools.reconstruction.sequence import read_sequence, relative_pose

ROOM_DEPTH_M = 2.0  # RedKitchen's; between 1 m and infinity its flow keeps its direction to 0.99 (cosine)


@dataclass(frozen=True, kw_only=True, eq=False)
class Video:
    """Frames in order and what truly happened in them.

    ``flow(index, points)`` gives the motion (M, 2) at pixels (M, 2), of any length; ``rotation`` (N, 3) the
    rotation vectors of ``cam_close_from_cam_open`` up to a common factor; ``judged`` the frames for which
    both are known.
    """

    name: str
    paths: list[Path]
    camera: Camera
    flow: Callable[[int, Array], Array]
    rotation: Array
    judged: range


def rendered(folder: Path) -> Video:
    """Return what tools.reconstruction.sequence wrote."""
    paths, truth = read_sequence(folder)
    height, width = (4 * side for side in truth.displacement.shape[1:3])

    def flow(index: int, points: Array) -> Array:
        column, row = np.rint((points - 1.5) / 4).astype(int).T
        grid = truth.displacement[index]
        at = np.clip(row, 0, height // 4 - 1), np.clip(column, 0, width // 4 - 1)
        return np.asarray(grid[at], float)

    rotation = np.array([rotation_vector(relative[:, :3]) for relative in truth.relative])
    camera = pinhole(truth.K, (width, height))
    judged = range(len(paths))
    return Video(name=folder.name, paths=paths, camera=camera, flow=flow, rotation=rotation, judged=judged)


def redkitchen(folder: Path) -> Video:
    """Return the recorded sequence; motion is the central difference of the neighbours' poses."""
    with np.load(folder / "poses.npz") as stored:
        poses, K, frames = stored["cam_from_world"], stored["K"], stored["frame"]
    paths = [folder / f"{frame:06d}.jpg" for frame in frames]
    K = K - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])  # 320, 240 is its centre in COLMAP's pixels
    ends = np.maximum(np.arange(len(poses)) - 1, 0), np.minimum(np.arange(len(poses)) + 1, len(poses) - 1)
    steps = [relative_pose(poses[first], poses[last]) for first, last in zip(*ends, strict=True)]

    def flow(index: int, points: Array) -> Array:
        rays = ROOM_DEPTH_M * homogeneous(points) @ np.linalg.inv(K).T
        moved = (rays @ steps[index][:, :3].T + steps[index][:, 3]) @ K.T
        return np.asarray(moved[:, :2] / moved[:, 2:] - points, float)

    rotation = np.array([rotation_vector(step[:, :3]) / 2 for step in steps])
    judged = range(1, len(paths) - 1)
    camera = pinhole(K, (640, 480))
    return Video(name="RedKitchen", paths=paths, camera=camera, flow=flow, rotation=rotation, judged=judged)


def pinhole(K: Array, size: tuple[int, int]) -> Camera:
    """Return the known camera of K, with COLMAP's parameters."""
    params = (K[0, 0], K[1, 1], *to_colmap(K[:2, 2]))
    return Camera(K=K, width=size[0], height=size[1], params=tuple(map(float, params)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Directed:
    """Frames after the vote: agreement (N,) with the true motion, confidences (N,), rotations (N, 3).

    Rotations are NaN where there is no pose; only frames that can be judged are in it.
    """

    agreement: Array
    confidence: Array
    rotation: Array
    true_rotation: Array

    @property
    def scale(self) -> float:
        """Return the length of the estimated rotations over that of the true ones, by their medians."""
        found = np.nanmedian(np.linalg.norm(self.rotation, axis=1))
        return float(found / np.median(np.linalg.norm(self.true_rotation, axis=1)))

    @property
    def rotation_error(self) -> Array:
        """Return the difference of rotation vectors, after scaling, over the true one's length, (N,)."""
        difference = np.linalg.norm(self.rotation / self.scale - self.true_rotation, axis=1)
        return np.asarray(difference / np.linalg.norm(self.true_rotation, axis=1))

    @property
    def same_sense(self) -> NDArray[np.bool_]:
        """Return where the rotation has the sense of the true one, (N,)."""
        return np.asarray((self.rotation * self.true_rotation).sum(axis=1) > 0)


def estimate_video(video: Video, network: blur2view.SmearNetwork) -> dict[str, list[ExposureViews]]:
    """Return the views of every frame by itself, with the intrinsics known and unknown."""
    views: dict[str, list[ExposureViews]] = {"known": [], "unknown": []}
    for path in video.paths:
        found = blur2view.estimate(blur2view.read_image(path), network=network, camera=video.camera)
        without = replace(found, geometry=blur2view.estimate_two_view(found.matches), camera=None)
        views["known"].append(views_of(path.name, found))
        views["unknown"].append(views_of(path.name, without))
    return views


def judge(video: Video, found: Sequence[ExposureViews]) -> Directed:
    """Return the frames after the vote beside the truth."""
    poses = [found[index].geometry.cam2_from_cam1 for index in video.judged]
    rotation = [np.full(3, np.nan) if pose is None else pose.rotation_vector for pose in poses]
    return Directed(
        agreement=np.array([agreement(found[i], partial(video.flow, i)) for i in video.judged]),
        confidence=np.array([found[i].time.confidence for i in video.judged]),
        rotation=np.array(rotation),
        true_rotation=video.rotation[list(video.judged)],
    )


def agreement(views: ExposureViews, flow: Callable[[Array], Array]) -> float:
    """Return the mean cosine between the inlier smears and the true motion; 0 without inliers."""
    kept = views.geometry.inlier_mask
    start, close = views.points_open[kept], views.points_close[kept]
    true = flow((start + close) / 2)
    lengths = np.linalg.norm(close - start, axis=1) * np.linalg.norm(true, axis=1)
    moved = lengths > 0
    cosine = ((close - start) * true).sum(axis=1)[moved] / lengths[moved]
    return float(cosine.mean()) if len(cosine) else 0.0


LEGEND = """
Right: frames whose inlier smears, open to close, go with the true motion. Scale: length of the rotations
found over that of the poses' (of RedKitchen's per frame interval); error: of the rotation vector after that
scale, over the true one's length.
"""
HEAD = (
    "video | intrinsics | frames | right before the vote % | right % | called known % | of those right % "
    "| median cosine | rotation in the right sense % | scale | rotation error, median"
)


def row(name: str, given: str, before: Directed, after: Directed) -> str:
    """Return a line of the table."""
    known = after.confidence > 0
    cells = [
        *(name, given, str(len(after.agreement))),
        *(f"{100 * share:.1f}" for share in ((before.agreement > 0).mean(), (after.agreement > 0).mean())),
        f"{100 * known.mean():.1f}",
        f"{100 * (after.agreement[known] > 0).mean():.1f}" if known.any() else "-",
        f"{np.median(after.agreement):.2f}",
    ]
    posed = np.isfinite(after.rotation).all(axis=1)
    if posed.any():
        error = float(np.median(after.rotation_error[posed]))
        cells += [f"{100 * after.same_sense[posed].mean():.1f}", f"{after.scale:.3f}", f"{error:.3f}"]
    else:
        cells += ["-", "-", "-"]
    return f"| {' | '.join(cells)} |"


def plot(path: Path, videos: Sequence[tuple[str, Directed]]) -> None:
    """Draw the three components of the rotation vectors over time, estimated ones after the common scale."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, len(videos), figsize=(6 * len(videos), 7), squeeze=False, sharex="col")
    for column, (name, found) in enumerate(videos):
        for component, label in enumerate("xyz"):
            axis = axes[component][column]
            axis.plot(np.degrees(found.true_rotation[:, component]), "k-", label="poses")
            estimated = np.degrees(found.rotation[:, component] / found.scale)
            axis.plot(estimated, "C1.-", label=f"blur, over {found.scale:.2f}")
            axis.set_ylabel(f"{label}, degrees")
            axis.axhline(0, color="0.8", zorder=0)
        axes[0][column].set_title(f"{name}: rotation during the exposure")
        axes[0][column].legend()
        axes[2][column].set_xlabel("frame")
    figure.tight_layout()
    figure.savefig(path, dpi=90)
    plt.close(figure)


def report(
    videos: Sequence[Video], network: blur2view.SmearNetwork
) -> tuple[str, list[tuple[str, Directed]]]:
    """Estimate, vote and judge; return the table and what is to be drawn."""
    lines, drawn = [f"| {HEAD} |", "|---" * 11 + "|"], []
    for video in videos:
        matched = cache(PhotographMatcher(video.paths))
        for given, views in estimate_video(video, network).items():
            found = with_time_direction(views, [list(range(len(views)))], matched)
            before, after = judge(video, views), judge(video, found)
            lines.append(row(video.name, given, before, after))
            if np.isfinite(after.rotation).any():
                drawn.append((video.name, after))
    return "\n".join(lines) + "\n", drawn


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument(
        "--rendered", type=existing, nargs="+", default=[], help="folders of rendered sequences"
    )
    parser.add_argument("--redkitchen", type=existing, help="folder of the recorded sequence")
    parser.add_argument("--out", type=target, help="write <out>.md and <out>.png")
    parser.add_argument("--model", type=existing, help="another network than the shipped one")
    arguments = parser.parse_args()
    videos = [rendered(folder) for folder in arguments.rendered]
    videos += [redkitchen(arguments.redkitchen)] if arguments.redkitchen else []
    network = blur2view.SmearNetwork(arguments.model)
    lines, drawn = report(videos, network)
    head = f"Written by `python -m tools.reconstruction.time_direction`, network {network.info.model_id}."
    text = f"{head}\n{LEGEND}\n{lines}"
    print(text, end="")
    if arguments.out is not None:
        arguments.out.with_suffix(".md").write_text(text)
        if drawn:
            plot(arguments.out.with_suffix(".png"), drawn)


if __name__ == "__main__":
    main()
