"""A series of angular velocities against a recorder's poses.

``blur2view estimate FOLDER --sequence --camera CAMERA --csv rates.csv``, then ``python -m
tools.evaluation.rates rates.csv poses.npz`` prints in how many frames the rate points the right way, and the
correlation of wx, wy and wz with the poses' rates, of single frames and of means over five. ``poses.npz``
holds ``frame`` (N,), by which rows are named or numbered, and ``cam_from_world`` (N, 3, 4).
"""

import csv
import re
from pathlib import Path

import numpy as np

from blur2view.arrays import Array
from blur2view.exposure.trajectory import Trajectory
from tools.arguments import existing, parser_of
from tools.pages import table

Series = dict[int, Array]  # by the frame's number: a rate (3,) of any one unit
MEAN_OF = 5  # frames: poses are noisy, and pictures not taken at even times


def rates_of_table(path: Path) -> Series:
    """Return the rates of a table of ``blur2view estimate --csv``, of the frames that have one."""
    with path.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["wx"]]
    return {frame_of(row): np.array([float(row[axis]) for axis in ("wx", "wy", "wz")]) for row in rows}


def frame_of(row: dict[str, str]) -> int:
    """Return a row's frame: its number in the video, or the last number of its name."""
    return int(row["frame"] or re.findall(r"\d+", Path(row["name"]).stem)[-1])


def rates_of_poses(path: Path) -> Series:
    """Return the rotation per frame about each pose."""
    with np.load(path) as file:
        rates = Trajectory(poses=file["cam_from_world"]).velocities(1.0)[:, :3]
        return dict(zip(file["frame"].tolist(), rates, strict=True))


def averaged(series: Series, count: int = MEAN_OF) -> Series:
    """Return means over so many consecutive frames, by the middle one."""
    around = range(-(count // 2), count // 2 + 1)
    return {
        k: np.mean([series[k + step] for step in around], axis=0)
        for k in series
        if all(k + step in series for step in around)
    }


def agreement(title: str, one: Series, other: Series) -> tuple[object, ...]:
    """Return a row of the table: in how many frames two series agree in direction, correlations by axis."""
    frames = sorted(one.keys() & other.keys())
    if len(frames) < 3:
        return title, len(frames), "", "", "", ""
    a, b = (np.array([series[k] for k in frames]) for series in (one, other))
    right = f"{((a * b).sum(axis=1) > 0).mean():.1%}"
    return title, len(frames), right, *(f"{np.corrcoef(a[:, k], b[:, k])[0, 1]:.3f}" for k in range(3))


def page(rates: Series, poses: Series) -> str:
    """Return how single frames agree, and means of several, as Markdown."""
    means = agreement(f"means of {MEAN_OF}", averaged(rates), averaged(poses))
    rows = [agreement("single frames", rates, poses), means]
    return "\n".join(table(" | frames | same way | wx | wy | wz", rows))


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("table", type=existing, help="CSV of blur2view estimate")
    parser.add_argument("poses", type=existing, help="the recorder's poses, .npz")
    arguments = parser.parse_args()
    print(page(rates_of_table(arguments.table), rates_of_poses(arguments.poses)))


if __name__ == "__main__":
    main()
