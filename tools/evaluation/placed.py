"""What ``blur2view place`` gains over interpolation, on rendered videos of a hand's shake with exact poses.

``python -m tools.evaluation.placed WORK --out tools/results/placed.md`` renders videos (`VideoOptions`), lets
COLMAP triangulate and adjust from the true poses with the features of their blurred frames, links and places;
all is kept in WORK. Each frame's motion from its own pose to both ends of its exposure is compared with the
true one, after one scale for each model, in the better order of the ends: rotation, position, and over the
exposure the mean distance of points at one and a half of the scene's depth from where they are. The
cubic *spline* through the frames' own poses is given the exposure, as *place, given* is.
"""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
from scipy.interpolate import make_interp_spline

from blur2view.arrays import Array
from blur2view.cli import commands
from blur2view.colmap.placement import place_views
from blur2view.exposure.trajectory import changed, relative_motion
from blur2view.geometry.pose import rotation_matrix, rotation_vector
from tools.command import publish, run, table
from tools.rendering.video import Shake, VideoOptions, write_video

SHAKES = {"30, slower": (30, 0.7, 10), "10, as fast": (10, 0.7, 10), "10, faster": (10, 6, 12)}
"""Frames a second and how fast the shake is beside half of that: the bounds of its frequencies, Hz."""
SHARES = (0.33, 0.6, 0.9)  # exposure over frame interval
METHODS = ("spline", "place, given", "place")
TIMES: Array = np.linspace(-1, 1, 9)  # from shutter-open to shutter-close
DEPTHS = (0.5, 1.0)
TITLE = "Both ends of exposures, placed and interpolated"
HEAD = (
    "frames a second, shake | exposure | frames | smear, px | method | rotation, degrees "
    "| position, 1/1000 of the depth | pixels | exposure as measured"
)

Poses = dict[str, Array]  # by frame: cam_from_world (3, 4), or changes (2, 6) to both ends


def extracted(database: Path, frames: Path, camera: Any, features: Any = None, matching: Any = None) -> Path:
    """Return a new project of a folder of frames with COLMAP's features and matches, of a known camera."""
    database.unlink(missing_ok=True)
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model, reader.camera_params = camera.model.name, ",".join(map(str, camera.params))
    pycolmap.extract_features(
        database,
        frames,
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=reader,
        extraction_options=features or pycolmap.FeatureExtractionOptions(),
    )
    pycolmap.match_exhaustive(database, matching_options=matching or pycolmap.FeatureMatchingOptions())
    return database


def camera_of(options: VideoOptions) -> Any:
    """Return the pycolmap.Camera of a rendered video."""
    (width, height), f = options.size, options.focal_px
    params = [f, f, width / 2, height / 2]
    return pycolmap.Camera(model="PINHOLE", width=width, height=height, params=params)


def reconstruct(folder: Path, options: VideoOptions, true: Poses) -> tuple[Path, Path]:
    """Return the linked project of the frames, and their model as COLMAP's bundle adjustment leaves it.

    It begins at the true poses, so that none is lost; those that it ends at err as features in blur do.
    """
    database, frames, model = folder / "project.db", folder / "frames", folder / "model"
    if not model.exists():
        extracted(database, frames, camera_of(options))
        made = pycolmap.triangulate_points(begun(database, true), database, frames, folder)
        fixed = pycolmap.BundleAdjustmentOptions()
        fixed.refine_focal_length = fixed.refine_extra_params = False
        pycolmap.bundle_adjustment(made, fixed)
        words = ["to-colmap", "--db", database, "--link", "--sequence", "--no-backup", "--jobs", 1, frames]
        if commands.main([str(word) for word in words]):
            raise SystemExit(f"{folder}: its frames cannot be linked")
        model.mkdir()
        made.write(model)
    return database, model


def begun(database: Path, poses: Poses) -> Any:
    """Return a reconstruction of a project's images at these poses, without points."""
    model = pycolmap.Reconstruction()
    with pycolmap.Database.open(database) as opened:
        for kind in ("camera", "rig", "frame"):
            for one in getattr(opened, f"read_all_{kind}s")():
                getattr(model, f"add_{kind}")(one)
        for image in opened.read_all_images():
            model.add_image(image)
            pose = pycolmap.Rigid3d(poses[image.name])
            model.frame(image.frame_id).set_cam_from_world(image.camera_id, pose)
            model.register_frame(image.frame_id)
    return model


def poses_of(model: Any) -> Poses:
    """Return the poses of a model by name."""
    return {one.name: one.cam_from_world().matrix() for one in model.images.values() if one.has_pose}


def centre_of(pose: Array) -> Array:
    """Return the centre (3,) of a camera (3, 4)."""
    return np.asarray(-pose[:, :3].T @ pose[:, 3])


def placed_steps(poses: Poses) -> Poses:
    """Return the changes (2, 6) from frames to their views, by name, in a model with these poses."""
    return {
        name: np.array([relative_motion(pose, poses[f"{name}#{end}"]) for end in ("open", "close")])
        for name, pose in poses.items()
        if f"{name}#open" in poses and f"{name}#close" in poses
    }


def interpolated_steps(poses: Poses, share: float) -> Poses:
    """Return the changes (2, 6) from frames to both ends on a cubic spline through all poses in order."""
    names = sorted(poses)
    first = poses[names[0]][:, :3]
    turns = [rotation_vector(poses[name][:, :3] @ first.T) for name in names]
    places = np.hstack([turns, [centre_of(poses[name]) for name in names]])
    spline = make_interp_spline(np.arange(len(names)), places, k=3)

    def at(time: float) -> Array:
        place = spline(time)
        R = rotation_matrix(place[:3]) @ first
        return np.column_stack([R, -R @ place[3:]])

    return {
        name: np.array([relative_motion(poses[name], at(index + step)) for step in (-share / 2, share / 2)])
        for index, name in enumerate(names)
    }


def scale_of(poses: Poses, true: Poses) -> float:
    """Return the scale from a model to the scene: the ratio of the cameras' distances from their mean."""
    centres = [np.array([centre_of(one[name]) for name in poses]) for one in (poses, true)]
    spread = [np.linalg.norm(one - one.mean(axis=0)) for one in centres]
    return float(spread[1] / spread[0])


def pixels(pose: Array, options: VideoOptions) -> Array:
    """Return the pixels (depths, N, 2) of a lattice of points before a camera."""
    x, y = (np.linspace(0, side - 1, 7) for side in options.size)
    lattice = np.stack([*np.meshgrid(x, y), np.ones((7, 7))], -1).reshape(-1, 3)
    points = np.array(DEPTHS)[:, None, None] * (lattice @ np.linalg.inv(options.K).T)
    seen = (points @ pose[:, :3].T + pose[:, 3]) @ options.K.T
    return np.asarray(seen[..., :2] / seen[..., 2:])


def errors(step: Array, path: Shake, options: VideoOptions) -> list[float]:
    """Return the errors of changes (2, 6) in the better order of ends: degrees, units of depth, pixels."""
    middle = np.eye(3, 4)
    true = [changed(middle, relative_motion(path.pose(0.0), path.pose(tau))) for tau in TIMES / 2]
    found = []
    for one in (step, step[::-1]):
        ends = list(zip([changed(middle, change) for change in one], (true[0], true[-1]), strict=True))
        turns = [rotation_vector(a[:, :3] @ b[:, :3].T) for a, b in ends]
        moves = [centre_of(a) - centre_of(b) for a, b in ends]
        between = [changed(middle, abs(time) * one[int(time > 0)]) for time in TIMES]
        seen = [pixels(a, options) - pixels(b, options) for a, b in zip(between, true, strict=True)]
        apart = [float(np.linalg.norm(vectors, axis=-1).mean()) for vectors in (turns, moves, seen)]
        found.append([float(np.degrees(apart[0])), *apart[1:]])
    return min(found, key=lambda one: one[2])


def measure(work: Path, key: dict[str, Any]) -> dict[str, Any]:
    """Return the key of a video with errors of every frame by every method, the exposure and the smears."""
    rate, *hertz = SHAKES[key["shake"]]
    share, seed = key["share"], key["seed"]
    options = VideoOptions(rate=rate, share=share, hertz=(hertz[0], hertz[1]))
    folder = work / "_".join(str(value).replace(", ", "_").replace(" ", "_") for value in key.values())
    paths = write_video(folder / "frames", seed, options)
    true = {f"f_{index:03d}.png": path.pose(0.0) for index, path in enumerate(paths)}
    database, model = reconstruct(folder, options, true)
    poses = poses_of(pycolmap.Reconstruction(model))
    known, free = (place_views(database, model, sorted(true), given) for given in (share, None))
    steps = [interpolated_steps(poses, share)]
    steps += [placed_steps(poses_of(placement.model)) for placement in (known, free)]
    to_scene, by_name = np.repeat([1, scale_of(poses, true)], 3), dict(zip(true, paths, strict=True))
    record = {**key, "fraction": free.fraction}
    for method, ends in zip(METHODS, steps, strict=True):
        record[method] = [errors(ends[one] * to_scene, by_name[one], options) for one in true if one in ends]
    ends_seen = [pixels(path.pose(-0.5), options) - pixels(path.pose(0.5), options) for path in paths]
    return record | {"smear": [float(np.linalg.norm(one, axis=-1).mean()) for one in ends_seen]}


def medians(records: list[dict[str, Any]]) -> list[tuple[object, ...]]:
    """Return rows of the medians of every cell."""
    rows: list[tuple[object, ...]] = []
    for shake, share in product(SHAKES, SHARES):
        cell = [one for one in records if (one["shake"], one["share"]) == (shake, share)]
        for method in METHODS if cell else ():
            values = np.array([error for one in cell for error in one[method]])
            degrees, depth, px = np.median(values, axis=0)
            smear = np.median([length for one in cell for length in one["smear"]])
            own = f"{np.median([one['fraction'] for one in cell]):.2f}" if method == "place" else ""
            figures = f"{degrees:.3f}", f"{1000 * depth:.2f}", f"{px:.2f}"
            rows.append((shake, share, len(values), f"{smear:.0f}", method, *figures, own))
    return rows


def main(work: Path, *, scenes: int = 3, out: Path | None = None) -> None:
    """Measure ``scenes`` videos of every cell; ``work`` keeps their renderings, projects and models."""
    cells = product(range(scenes), SHAKES, SHARES)
    keys = [{"shake": shake, "share": share, "seed": seed} for seed, shake, share in cells]
    rows = medians([measure(work, key) for key in keys])
    publish(out, f"# {TITLE}", table(HEAD, rows), "Medians over frames.")


if __name__ == "__main__":
    run(main)
