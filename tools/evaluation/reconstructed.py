"""What ``blur2view reconstruct`` makes of a video whose true poses are known, beside COLMAP on every frame.

``python -m tools.evaluation.reconstructed SEQUENCE WORK --out tools/results/reconstructed.md`` reads the
frames of a sequence that has a ``model``; with ``--wider 1`` or more runs of 5 of every 15 are averages.
"""

import time
from pathlib import Path

import cv2
import numpy as np
import pycolmap

from blur2view.arrays import Array
from blur2view.exposure.trajectory import CameraPath
from blur2view.geometry.pose import rotation_vector
from blur2view.reconstruction import mapping
from blur2view.reconstruction.reconstruct import EXPOSURES, ReconstructionOptions, reconstruct
from tools.command import Existing, Target, publish, run, table
from tools.evaluation.placed import Poses, centre_of, poses_of
from tools.evaluation.recovered import averaged, missing_of

RUN, BETWEEN = 5, 10
LEAD = """\
A sequence whose every frame has a pose; runs of 5 of every 15 frames are the mean of 2 *wider* + 1
consecutive ones in linear light (0: as they are). *COLMAP* has every frame, exhaustive matching, default
options; *spline* goes through the frames that COLMAP registers for the scene, the sharpest. After a
similarity that aligns frames with the true ones, errors of rotation are in degrees and of position in steps,
the median distance of consecutive frames: median / 90 % over frames with a pose. Seconds are of a processor's
cores, without child processes."""
HEAD = "wider | way | frames with a pose | degrees | steps | CPU s"


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


def row(wider: int, way: str, poses: Poses, true: Poses, seconds: str) -> tuple[str, ...]:
    """Return the row of a table."""
    median, most = np.quantile(errors(poses, true), [0.5, 0.9], axis=0)
    figures = [f"{median[k]:.2f} / {most[k]:.2f}" for k in (0, 1)]
    return str(wider), way, f"{len(poses)} of {len(true)}", *figures, seconds


def measured(source: Path, work: Path, wider: int) -> list[tuple[str, ...]]:
    """Return the rows of a sequence; a scene that is there is gone on with."""
    true = dict(sorted(poses_of(pycolmap.Reconstruction(source / "model")).items()))
    names = list(true)
    write_frames(source, work / "frames", names, wider)
    begun, there = time.process_time(), (work / "scene" / "report.html").exists()
    made = reconstruct(work / "frames", work / "scene", ReconstructionOptions(all_frames=True))
    own_s = "made before" if there else f"{time.process_time() - begun:.0f}"
    poses = {
        k: v for k, v in poses_of(pycolmap.Reconstruction(work / "scene" / EXPOSURES)).items() if k in true
    }
    known = [name for name in made.registered if name in poses]
    path = CameraPath(
        np.array([names.index(k) for k in known]), np.stack([poses[k] for k in known]), len(names)
    )
    between = {name: path.at(names.index(name)) for name in names}
    spline = {name: pose for name, pose in between.items() if pose is not None}
    begun = time.process_time()
    database = work / "colmap.db"
    mapping.match(database, work / "frames", names, camera=("SIMPLE_RADIAL", ""), blurred=False)
    models = mapping.mapped(
        database, work / "frames", work / "colmap", mapper="incremental", camera_known=False
    )
    colmap_s = time.process_time() - begun
    rows = [row(wider, "COLMAP", poses_of(models[0]), true, f"{colmap_s:.0f}")] if models else []
    rows.append(row(wider, "spline", spline, true, "-"))
    return [*rows, row(wider, "scene", poses, true, own_s)]


def main(sequence: Existing, work: Path, *, wider: list[int] = [0], out: Target | None = None) -> None:  # noqa: B006
    """Measure a sequence, its runs averaged over so many frames before and after."""
    rows = [one for count in wider for one in measured(sequence, work / f"wider_{count}", count)]
    publish(out, "# Scenes of blurred videos", LEAD, table(HEAD, rows))


if __name__ == "__main__":
    run(main)
