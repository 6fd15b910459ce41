"""What ``blur2view reconstruct`` makes of a video whose true poses are known, beside COLMAP on its frames.

``python -m tools.evaluation.reconstructed SEQUENCE WORK --out tools/results/reconstructed.md`` reads the
frames of a sequence that has a ``model``. With ``--wider 1`` or more runs of 5 of every 15 are averages, with
``--known-camera`` all ways get the model's camera, with ``--foreign FOLDER`` frames of another scene stand
for one in three. With ``--parts 20 40`` the first, middle and last so many frames are measured by themselves,
with ``--scenes 4`` so many rendered videos of a hand's shake (`VideoOptions`) whose runs have long exposures.
``--frames 16`` chooses at most so many frames, as of longer videos, where of 60 or fewer all are chosen. A
scene that is there is gone on with.
"""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pycolmap

from blur2view.arrays import Array
from blur2view.exposure.trajectory import CameraPath
from blur2view.geometry.pose import rotation_vector
from blur2view.images.image import read_picture
from blur2view.reconstruction import mapping
from blur2view.reconstruction.options import ReconstructionOptions
from blur2view.reconstruction.reconstruct import reconstruct
from blur2view.reconstruction.scene import EXPOSURES
from tools.command import Existing, Target, publish, run, table
from tools.evaluation.placed import Poses, camera_of, centre_of, poses_of
from tools.evaluation.recovered import SHORT, averaged, missing_of
from tools.rendering.video import VideoOptions, write_video

RUN, BETWEEN, ALL = 5, 10, slice(None)
RENDERED = VideoOptions(rate=30, share=0.9, frames=60, shake_px=20.0)
FOREIGN = 3  # one in so many frames is of another scene
LEAD = """\
A sequence whose every frame has a pose; runs of 5 of every 15 frames are the mean of 2 *wider* + 1
consecutive ones in linear light (0: as they are); of *rendered* videos they have long exposures, the others
short ones. *COLMAP* has every frame, exhaustive matching, default options. *Spline* goes through the frames
that COLMAP registers of the sharpest by Laplacian, one of each of equal stretches, as many as the scene's
COLMAP gets. *Scene* has all frames (`--all-frames`). After a similarity that aligns frames with the true
ones, errors of rotation are in degrees and of position in steps, the median distance of consecutive frames:
median / 90 % over frames with a pose, and over those of the runs apart. Seconds are of a processor's cores,
of the system and child processes, too. *Foreign* frames are of another scene: those that got a pose."""
PLACES = "first", "middle", "last"
HEAD = (
    "wider | camera | way | frames with a pose | degrees | steps | runs: frames | degrees | steps | CPU s "
    "| foreign"
)


def write_frames(source: Path, folder: Path, names: list[str], wider: int) -> None:
    """Write the frames, those of runs averaged."""
    folder.mkdir(parents=True, exist_ok=True)
    worse = set(missing_of(names, RUN, BETWEEN)) if wider else set()
    for k, name in enumerate(names):
        content = (source / name).read_bytes()
        if name in worse:
            mean = averaged([source / one for one in names[max(0, k - wider) : k + wider + 1]])
            content = bytes(cv2.imencode(".jpg", mean, [cv2.IMWRITE_JPEG_QUALITY, 98])[1])
        (folder / name).write_bytes(content)


def errors(poses: Poses, true: Poses) -> Array:
    """Return degrees and steps (N, 2) of poses after the similarity that aligns their centres."""
    names = [name for name in true if name in poses]
    own, goal = (np.array([centre_of(one[name]) for name in names]) for one in (poses, true))
    centred, towards = own - own.mean(axis=0), goal - goal.mean(axis=0)
    # turned by the mean of the frames' own rotations, as centres on a line leave one open
    U, _, Vt = np.linalg.svd(sum(true[name][:, :3].T @ poses[name][:, :3] for name in names))
    R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    scale = (towards * (centred @ R.T)).sum() / (centred**2).sum()
    every = np.array([centre_of(pose) for pose in true.values()])
    step = float(np.median(np.linalg.norm(np.diff(every, axis=0), axis=1)))
    off = np.linalg.norm(scale * centred @ R.T - towards, axis=1) / step
    turns = [
        np.linalg.norm(rotation_vector(poses[name][:, :3] @ R.T @ true[name][:, :3].T)) for name in names
    ]
    return np.column_stack([np.degrees(turns), off])


def row(case: tuple[str, ...], way: str, poses: Poses, true: Poses, *more: str) -> tuple[str, ...]:
    """Return the row of a table."""
    off = dict(zip([name for name in true if name in poses], errors(poses, true), strict=True))
    figures = list[str]()
    for names in (list(true), missing_of(list(true), RUN, BETWEEN)):
        some = np.array([off[name] for name in names if name in off]).reshape(-1, 2)
        median, most = np.quantile(some, [0.5, 0.9], axis=0) if len(some) else np.full((2, 2), np.nan)
        figures += [f"{len(some)} of {len(names)}", *(f"{median[k]:.2f} / {most[k]:.2f}" for k in (0, 1))]
    return *case, way, *figures, *more


def cpu_s() -> float:
    """Return the seconds of processors that this process and its ended children have used."""
    return sum(os.times()[:4])


def sharpest(folder: Path, names: list[str], count: int) -> list[str]:
    """Return the sharpest frame by the variance of its Laplacian of each of so many equal stretches."""

    def sharpness(name: str) -> float:
        grey = np.asarray(cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE))
        return float(cv2.Laplacian(grey, cv2.CV_64F).var())

    return [max(part.tolist(), key=sharpness) for part in np.array_split(np.array(names), count)]


def by_colmap(
    work: Path, frames: Path, names: list[str], options: ReconstructionOptions
) -> tuple[Poses, float]:
    """Return the poses of COLMAP's largest model of frames, from nothing, and its seconds."""
    shutil.rmtree(work, ignore_errors=True)
    begun, database = cpu_s(), work / "matches.db"
    camera = options.for_colmap(read_picture(frames / names[0], as_stored=True).size)
    mapping.find_features(database, frames, names, camera=camera, blurred=False)
    mapping.match(database, names, blurred=False)
    known = bool(options.camera)
    models = mapping.mapped(database, frames, work / "models", mapper="incremental", camera_known=known)
    return poses_of(models[0]) if models else {}, cpu_s() - begun


def splined(poses: Poses, names: list[str]) -> Poses:
    """Return poses of all frames by a spline through these."""
    known = [name for name in names if name in poses]
    if len(known) < 2:
        return {}
    places = np.array([names.index(name) for name in known])
    path = CameraPath(places, np.stack([poses[name] for name in known]), len(names))
    between = {name: path.at(place) for place, name in enumerate(names)}
    return {name: pose for name, pose in between.items() if pose is not None}


def put_among(frames: Path, names: list[str], folder: Path, count: int) -> list[str]:
    """Write frames of another scene in the place of some; return which are theirs."""
    others = sorted(path for path in folder.iterdir() if "truth" not in path.name)
    places = names[1::FOREIGN][:count]
    size = read_picture(frames / names[0], as_stored=True).pixels.shape[1::-1]
    for name, other in zip(places, others[:: max(1, len(others) // len(places))], strict=False):
        small = cv2.resize(np.asarray(cv2.imread(str(other))), size, interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(frames / name), small, [cv2.IMWRITE_JPEG_QUALITY, 98])
    return places


def words_of(camera: pycolmap.Camera) -> str:
    """Return a camera as COLMAP writes it."""
    return " ".join(map(str, (camera.model_name, camera.width, camera.height, *camera.params)))


def of_sequence(source: Path, frames: Path, wider: int, part: slice = ALL) -> tuple[Poses, str]:
    """Write a sequence's frames, or a part of them; return their true poses and the camera."""
    model = pycolmap.Reconstruction(source / "model")
    true = dict(sorted(poses_of(model).items())[part])
    write_frames(source, frames, list(true), wider)
    return true, words_of(*model.cameras.values())


def of_rendering(work: Path, frames: Path, seed: int) -> tuple[Poses, str]:
    """Render a video whose runs have long exposures; return its frames' true poses and the camera."""
    names = [f"f_{k:03d}.png" for k in range(RENDERED.frames)]
    worse = set(missing_of(names, RUN, BETWEEN))
    kept = [k for k, name in enumerate(names) if name not in worse]
    paths = write_video(work / "short", seed, replace(RENDERED, share=SHORT), kept)
    write_video(work / "long", seed, RENDERED, [k for k, name in enumerate(names) if name in worse])
    true = {name: path.pose(0.0) for name, path in zip(names, paths, strict=True)}
    frames.mkdir(parents=True, exist_ok=True)
    for name in true:
        shutil.copyfile(work / ("long" if name in worse else "short") / name, frames / name)
    return true, words_of(camera_of(RENDERED))


def measured(
    frames: Path,
    true: Poses,
    options: ReconstructionOptions,
    case: tuple[str, str],
    foreign: Path | None = None,
) -> list[tuple[str, ...]]:
    """Return the rows of frames with true poses; a scene that is there is gone on with."""
    names, work = list(true), frames.parent
    there = (work / "scene" / "report.html").exists()
    others = put_among(frames, names, foreign, 20) if foreign else []
    begun = cpu_s()
    made = reconstruct(frames, work / "scene", options)
    own_s = "made before" if there else f"{cpu_s() - begun:.0f}"
    poses = poses_of(pycolmap.Reconstruction(work / "scene" / EXPOSURES))
    got = f"{len([name for name in others if name in poses])} of {len(others)}" if foreign else "-"
    true = {name: pose for name, pose in true.items() if name not in others}
    rows = [row(case, "scene", poses, true, own_s, got)]
    if not foreign:
        some = sharpest(frames, names, len(made.mapped))
        chosen, chosen_s = by_colmap(work / "laplacian", frames, some, options)
        rows.insert(0, row(case, "spline", splined(chosen, names), true, f"{chosen_s:.0f}", "-"))
        every, every_s = by_colmap(work / "colmap", frames, names, options)
        rows.insert(0, row(case, "COLMAP", every, true, f"{every_s:.0f}", "-"))
    return rows


def main(
    sequence: Existing,
    work: Path,
    *,
    wider: list[int] = [],  # noqa: B006
    parts: list[int] = [],  # noqa: B006
    scenes: int = 0,
    frames: int = 300,
    known_camera: bool = False,
    foreign: Existing | None = None,
    out: Target | None = None,
) -> None:
    """Measure a sequence, its runs averaged over so many frames before and after, and rendered videos.

    The sequence as it is, if nothing else is asked for.
    """
    rows, known = list[tuple[str, ...]](), "known" if known_camera else "found"
    common = ReconstructionOptions(all_frames=True, frames=frames)

    def options(camera: str) -> ReconstructionOptions:
        return replace(common, camera=camera * known_camera)

    for count in wider or [0] * (not parts and not scenes):
        folder = work / f"wider_{count}{'_known' * known_camera}{'_foreign' * bool(foreign)}"
        true, camera = of_sequence(sequence, folder / "frames", count)
        rows += measured(folder / "frames", true, options(camera), (str(count), known), foreign)
        publish(out, "# Scenes of blurred videos", LEAD, table(HEAD, rows))
    every = len(pycolmap.Reconstruction(sequence / "model").images)
    firsts = [(n, place, share * (every - n) // 2) for n in parts for share, place in enumerate(PLACES)]
    for count, place, first in firsts:
        folder = work / f"{place}_{count}{'_known' * known_camera}"
        true, camera = of_sequence(sequence, folder / "frames", 0, slice(first, first + count))
        rows += measured(folder / "frames", true, options(camera), (f"0, {place} {count}", known))
        publish(out, "# Scenes of blurred videos", LEAD, table(HEAD, rows))
    for seed in range(scenes):
        folder = work / f"rendered_{seed}{'_known' * known_camera}"
        true, camera = of_rendering(folder, folder / "frames", seed)
        rows += measured(folder / "frames", true, options(camera), (f"rendered {seed}", known))
        publish(out, "# Scenes of blurred videos", LEAD, table(HEAD, rows))


if __name__ == "__main__":
    run(main)
