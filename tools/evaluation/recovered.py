"""What ``blur2view recover`` gains over interpolation, on frames whose poses are known.

``python -m tools.evaluation.recovered WORK --out tools/results/recovered.md`` renders videos of a hand's
shake (`VideoOptions`) with short exposures and with long ones; runs of the latter are missing from a model
that COLMAP triangulates of the former, from the true poses. With ``--sequence FOLDER``, of frames and their
``model``, also that: the model is that of the other frames, whose points are adjusted without the missing
ones. The page says what its columns mean.
"""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycolmap
from scipy.stats import chi2

from blur2view.arrays import AnyArray, Array
from blur2view.colmap.blur_matching import GAMMA
from blur2view.colmap.frame_sequence import NEAR_FRAMES
from blur2view.colmap.recovery import adjust, recover_frames
from blur2view.exposure.trajectory import CameraPath, relative_motion
from blur2view.images.image import read_picture
from blur2view.networks.smear_network import SmearNetwork
from tools.command import publish, run, table
from tools.evaluation.drawn_path import BLUE, ORANGE, Panel, draw_paths
from tools.evaluation.placed import Poses, begun, camera_of, centre_of, extracted, poses_of
from tools.rendering.video import Shake, VideoOptions, sample_exposures, write_video

RUNS, WIDER = [1, 3, 6], (0, 1, 2, 3)  # frames missing in a row; frames averaged before and after
BETWEEN, MARGIN = 6, 4  # frames of the model from one run to the next, unless given, and at either end
RATES = (10, 30)  # frames a second
SHAKES_PX = (10.0, 30.0)  # of a frame, root mean square
SHORT, LONG = 0.05, 0.9  # exposures over frame interval, of frames of the model and of missing ones
FRAMES = 20
DRAWN = 5  # seed of the scene of the picture
LEAD = """\
Runs of frames are taken out of a COLMAP model, and `blur2view recover` registers them from its other frames.
The rendered videos show a hand's shake; their frames are sharp in the model and blurred in the runs. In the
recorded sequence a missing frame is the mean of 1, 3, 5 or 7 consecutive frames in linear light.

- *missing*, for example 3 of 9: three frames in a row are missing, and the next six are not.
- *spline*: the pose is interpolated between the model's frames, for every missing frame; *recovered*: the
  pose is that of `recover`, for the frames that it accepts.
- Errors of rotation are in degrees. Errors of position are in steps; a step is the median distance of
  consecutive frames. Errors, smears, and the number of the model's points that a recovered frame sees are
  medians over frames. *worst* is the largest error of rotation.
- *holds*: the share of recovered frames whose true pose lies in the region of 90 % that `recover` states.
  The constants of these regions were chosen on the rendered videos in runs of 3, with shakes of 10 and 30 px
  a frame, and on RedKitchen's rows of 3 of 9 and of 6 of 12 at 38 px, so that these rows are not a blind
  check. The other rows chose nothing: RedKitchen's 6 of 12 at 52 px holds 0.93 (its rotations alone 0.97, its
  positions 0.90), and 1 of 7 at 36 px 0.89 (1.00 and 0.89). 3 of 9 at 35 px, darkened to a tenth and with
  noise, holds 0.90 (1.00 and 0.86).

COLMAP at its best (`blur2view.blurred_options()` and exhaustive matching) was run once on the same 66 frames
of RedKitchen with runs of three missing. It registered all of them; at 38 px they are off by 0.49 degrees and
2.1 steps, and at 53 px by 0.42 degrees and 2.3 steps."""
HEAD = (
    "frames | missing | smear, px | recovered | spline: degrees | steps | recovered: degrees | steps | worst "
    "| spline's worst | points | holds"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A model that lacks frames, in folders ``model`` and ``frames`` of ``folder``, and the true poses."""

    folder: Path
    true: Poses
    missing: Sequence[str]

    def begin(self) -> bool:
        """Return whether the case must be made: its folder is empty then."""
        if (self.folder / "model").exists():
            return False
        shutil.rmtree(self.folder, ignore_errors=True)
        (self.folder / "frames").mkdir(parents=True)
        return True

    def end(self, model: Any) -> None:
        """Write the model."""
        (self.folder / "model").mkdir()
        model.write(self.folder / "model")


def missing_of(names: Sequence[str], run_length: int, between: int = BETWEEN) -> list[str]:
    """Return the frames that are missing, in runs."""
    inner = range(MARGIN, len(names) - MARGIN)
    return [names[k] for k in inner if (k - MARGIN) % (run_length + between) < run_length]


def averaged(paths: Sequence[Path]) -> AnyArray:
    """Return the mean of pictures in linear light, BGR, uint8."""
    light = np.mean([(read_picture(path).pixels / 255.0) ** GAMMA for path in paths], axis=0)
    return np.asarray(np.rint(255 * light ** (1 / GAMMA)), np.uint8)[..., ::-1]


def from_sequence(source: Path, folder: Path, run_length: int, between: int, wider: int) -> Case:
    """Return a sequence whose every frame a model has, with runs of frames made worse and left out."""
    model = pycolmap.Reconstruction(source / "model")
    true = poses_of(model)
    names = sorted(true)
    case = Case(folder=folder, true=true, missing=missing_of(names, run_length, between))
    if case.begin():
        for k, name in enumerate(names):
            if name not in case.missing or not wider:
                shutil.copyfile(source / name, folder / "frames" / name)
                continue
            blurred = averaged([source / one for one in names[k - wider : k + wider + 1]])
            cv2.imwrite(str(folder / "frames" / name), blurred, [cv2.IMWRITE_JPEG_QUALITY, 98])
        for name in case.missing:
            model.deregister_frame(model.find_image_with_name(name).frame_id)
        adjust(model, free=())
        case.end(model)
    return case


def rendered(work: Path, folder: Path, seed: int, options: VideoOptions, run_length: int) -> Case:
    """Return a rendered video, of which runs of frames have long exposures and are left out."""
    name = f"{options.rate:g}_{options.shake_px:g}_{seed}"
    sharp, blurred = work / f"{name}_short", work / f"{name}_long"
    paths = write_video(sharp, seed, replace(options, share=SHORT))
    write_video(blurred, seed, options)
    true = {f"f_{k:03d}.png": path.pose(0.0) for k, path in enumerate(paths)}
    case = Case(folder=folder, true=true, missing=missing_of(list(true), run_length))
    if case.begin():
        known = {name: pose for name, pose in true.items() if name not in case.missing}
        (folder / "known").mkdir()
        for name in true:
            shutil.copyfile((sharp if name in known else blurred) / name, folder / "frames" / name)
        for name in known:
            shutil.copyfile(sharp / name, folder / "known" / name)
        database = extracted(folder / "project.db", folder / "known", camera_of(options))
        made = pycolmap.triangulate_points(begun(database, known), database, folder / "known", folder)
        case.end(made)
    return case


def errors(pose: Array, true: Array, step: float) -> tuple[float, float]:
    """Return degrees, and steps from centre to centre, of two poses."""
    degrees = float(np.degrees(np.linalg.norm(relative_motion(pose, true)[:3])))
    return degrees, float(np.linalg.norm(centre_of(pose) - centre_of(true))) / step


def measured(case: Case, network: SmearNetwork) -> dict[str, list[Any]]:
    """Return the errors of a case's missing frames, of the spline and as recovered, and more of these."""
    names = sorted(case.true)
    times = {name: k for k, name in enumerate(names)}
    centres = np.array([centre_of(case.true[name]) for name in names])
    step = float(np.median(np.linalg.norm(np.diff(centres, axis=0), axis=1)))
    known = [k for k, name in enumerate(names) if name not in case.missing]
    path = CameraPath(np.array(known), np.stack([case.true[names[k]] for k in known]), NEAR_FRAMES)
    frames = case.folder / "frames"
    found = recover_frames(case.folder / "model", frames, names, network=network)
    smears = [network.predict(read_picture(frames / name).pixels) for name in case.missing]
    record: dict[str, list[Any]] = {key: [] for key in ("spline", "recovered", "points", "holds")}
    record["smear"] = [float(np.median(one.smears().length_px)) for one in smears]
    record["refused"] = list(found.refused)
    for name in case.missing:
        true, expected = case.true[name], path.expected(times[name])
        assert expected is not None
        record["spline"].append(errors(expected.pose, true, step))
        if frame := found.recovered.get(name):
            change = relative_motion(frame.pose, true)
            record["recovered"].append(errors(frame.pose, true, step))
            record["points"].append(len(frame.points))
            far = change @ np.linalg.solve(frame.covariance, change)
            record["holds"].append(bool(far < chi2.ppf(0.9, 6)))
    return record


def draw(case: Case, paths: Sequence[Shake], network: SmearNetwork, target: Path) -> None:
    """Draw where the camera of a rendered case looks, by COLMAP's model and with the recovered frames."""
    names = sorted(case.true)
    found = recover_frames(case.folder / "model", case.folder / "frames", names, network=network)
    known = [k for k, name in enumerate(names) if name not in case.missing]
    spline = CameraPath(np.array(known), np.stack([case.true[names[k]] for k in known]), NEAR_FRAMES)
    guessed = [spline.expected(names.index(name)) for name in case.missing]
    first = paths[0]
    whole = [first.pose((one.middle_s - first.middle_s) / first.exposure_s + tau)
             for one in paths for tau in np.linspace(-0.55, 0.55, 12)]  # fmt: skip
    line = gaze(whole)
    model = gaze([case.true[names[k]] for k in known])
    recovered = gaze([frame.pose for frame in found.recovered.values()])
    registered = f"COLMAP's model: {len(known)} of {len(names)} frames, a spline (x) through them"
    after = f"With recover: {len(known) + len(recovered)} of {len(names)}"
    draw_paths(
        [
            Panel(
                title=registered,
                line=line,
                dots={BLUE: model},
                crosses=gaze([one.pose for one in guessed if one]),
            ),
            Panel(title=after, line=line, dots={BLUE: model, ORANGE: recovered}, crosses=np.zeros((0, 2))),
        ],
        target,
    )


def gaze(poses: Sequence[Array]) -> Array:
    """Return where cameras (3, 4) look: degrees to the right and down of the z axis, (N, 2)."""
    forwards = np.array([pose[2, :3] for pose in poses])
    return np.asarray(np.degrees(np.arctan2(forwards[:, :2], forwards[:, 2:])))


def row(name: str, missing: str, records: Sequence[dict[str, list[Any]]]) -> tuple[Any, ...]:
    """Return the row of a table, of medians over frames."""
    together = {key: sum((one[key] for one in records), []) for key in records[0]}
    spline, own = (np.array(together[key]).reshape(-1, 2) for key in ("spline", "recovered"))
    total = len(spline)
    medians = [np.median(one, axis=0) for one in (spline, own)]
    figures = [text for degrees, steps in medians for text in (f"{degrees:.3f}", f"{steps:.2f}")]
    worst = [f"{one[:, 0].max():.2f}" for one in (own, spline)]
    smear, points = (f"{np.median(together[key]):.0f}" for key in ("smear", "points"))
    holds = f"{np.mean(together['holds']):.2f}"
    return (name, missing, smear, f"{len(own)} of {total}", *figures, *worst, points, holds)


def main(
    work: Path,
    *,
    sequence: Path | None = None,
    scenes: int = 2,
    run_lengths: list[int] = RUNS,
    between: int = BETWEEN,
    picture: Path | None = None,
    out: Path | None = None,
) -> None:
    """Measure cases of a folder of renderings, and of a sequence; or draw one rendered case as a picture."""
    network, rows = SmearNetwork(), []
    if picture is not None:
        options = VideoOptions(rate=RATES[-1], share=LONG, frames=FRAMES, shake_px=SHAKES_PX[-1])
        case = rendered(work, work / f"drawn_{DRAWN}", DRAWN, options, run_lengths[0])
        draw(case, sample_exposures(np.random.default_rng([DRAWN, RATES[-1]]), options), network, picture)
        return
    for rate, shake_px, run_length in product(RATES, SHAKES_PX, run_lengths if scenes else ()):
        options = VideoOptions(rate=rate, share=LONG, frames=FRAMES, shake_px=shake_px)
        folders = {seed: work / f"{rate}_{shake_px:g}_{run_length}_{seed}" for seed in range(scenes)}
        cases = [rendered(work, folder, seed, options, run_length) for seed, folder in folders.items()]
        records = [measured(case, network) for case in cases]
        rows.append(row(f"{rate} a second", f"{run_length} of {run_length + BETWEEN}", records))
    if sequence is not None:
        for run_length, wider in product(run_lengths, WIDER):
            folder = work / f"sequence_{run_length}_{between}_{wider}"
            case = from_sequence(sequence, folder, run_length, between, wider)
            missing = f"{run_length} of {run_length + between}"
            rows.append(row(sequence.name, missing, [measured(case, network)]))
    publish(out, "# Frames that a model lacks, recovered", LEAD, table(HEAD, rows))


if __name__ == "__main__":
    run(main)
