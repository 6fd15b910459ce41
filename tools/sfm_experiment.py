"""Reconstruct videos of blurred frames with COLMAP, without and with the views that their blur gives.

    python -m tools.sequence render/sequence --seed 1 --photos KODAK
    python -m tools.sfm_experiment --sequence render/sequence --out tools/results/sfm_experiment \
        --redkitchen ../shared/data/redkitchen_sequence

Each video goes through SIFT, sequential matching and incremental mapping with COLMAP's defaults and the true
intrinsics. Then ``blur2view to-colmap --link --sequence`` adds the views, and the mapper adds them to that
model under ``mapper_options(linked=True, keep_photographs=True)``; and all is mapped anew globally. Told are
what was registered, errors against the true poses after one similarity, and the motion during every exposure:
of the models' virtual views, and of the single photographs as they were estimated. The rendered video is also
run with its true smears in place of the network's. Writes OUT.md and OUT.png.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.cli import main as blur2view_main
from blur2view.colmap import to_colmap
from blur2view.errors import Blur2ViewError
from blur2view.exposure_views import CLOSE, OPEN
from blur2view.manifold import rotation_vector
from blur2view.mapping import global_options, mapper_options
from tools.alignment import (
    Motion,
    MotionErrors,
    Similarity,
    align,
    centres,
    common_scale,
    rotation_errors_deg,
)
from tools.recording import Recording, redkitchen_recording, rendered_recording
from tools.true_smears import link_true

Array = NDArray[Any]
OVERLAP = 6
"""Frames ahead that a frame is matched with."""
HEADER = "Of ``python -m tools.sfm_experiment``; see there what was done.\n"
INITIAL_ANGLE_DEG = 4.0
"""To begin a model with: in a second of hand-held video nothing is seen at COLMAP's 16 degrees."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """What COLMAP built: poses cam_from_world by image name."""

    poses: dict[str, Array]
    points: int
    error_px: float

    def of(self, names: Sequence[str]) -> Array:
        """Give the poses (N, 3, 4) of images; NaN where one is not registered."""
        return np.stack([self.poses.get(name, np.full((3, 4), np.nan)) for name in names])


@dataclass(frozen=True, kw_only=True, eq=False)
class Result:
    """A recording reconstructed: without views, with views, and every photograph's own estimate.

    Parameters
    ----------
    recording : Recording
    without, joined, averaged : Model
        The last with views, by global mapping.
    estimated : Motion
        From the database: single photographs, translations of unit length; NaN without a pose.
    facts : list of dict
        What ``to-colmap --json`` says of every photograph.
    model_id : str
    """

    recording: Recording
    without: Model
    joined: Model
    averaged: Model
    estimated: Motion
    facts: list[dict[str, Any]]
    model_id: str

    @property
    def names(self) -> list[str]:
        """Of the photographs."""
        return [path.name for path in self.recording.paths]

    def motion_of(self, model: Model) -> Motion:
        """Motion during the exposures by a model's views, in the truth's scale; NaN without a model."""
        if not model.poses:
            unknown = np.full((len(self.names), 3), np.nan)
            return Motion(turns=unknown, moves=unknown)
        first, last = (model.of([name + end for name in self.names]) for end in (OPEN, CLOSE))
        return Motion.between(first, last).scaled(1.0, self.alignment_of(model).scale)

    def alignment_of(self, model: Model) -> Similarity:
        """Align a model's photographs to the truth."""
        poses = model.of(self.names)
        seen = np.isfinite(poses).all(axis=(1, 2))
        return align(poses[seen], self.recording.poses[seen])

    @property
    def motion(self) -> Motion:
        """Motion during the exposures by the joined model."""
        return self.motion_of(self.joined)

    @property
    def true_motion(self) -> Motion:
        """True motion in the scale of the joined model's, for the picture."""
        return self.true_motion_for(self.motion)

    def true_motion_for(self, found: Motion) -> Motion:
        """Give the true motion; of unknown exposures scaled to the rotations found, by one factor."""
        factor = 1.0 if self.recording.exposure_known else self.exposure(found)
        return self.recording.motion.scaled(factor, factor)

    def exposure(self, found: Motion) -> float:
        """Exposure over frame interval, or over what is known to be true, as the rotations found tell."""
        return common_scale(found.turns, self.recording.motion.turns)

    def errors(self, found: Motion) -> MotionErrors:
        """Compare a motion with the true one."""
        return MotionErrors.of(found, self.true_motion_for(found))


def fresh_database(path: Path, recording: Recording) -> None:
    """Write features and verified matches of a recording, with its true intrinsics, by COLMAP's means."""
    import pycolmap

    K = recording.K
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "PINHOLE"
    reader.camera_params = ",".join(map(str, [K[0, 0], K[1, 1], *to_colmap(K[:2, 2])]))
    extraction, matching = pycolmap.FeatureExtractionOptions(), pycolmap.FeatureMatchingOptions()
    extraction.num_threads = matching.num_threads = 1
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap, pairing.quadratic_overlap = OVERLAP, False
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = 0
    pycolmap.extract_features(
        path,
        recording.paths[0].parent,
        [image.name for image in recording.paths],
        pycolmap.CameraMode.SINGLE,
        reader,
        extraction,
    )
    pycolmap.match_sequential(path, matching, pairing, verification)


def run_mapper(
    database: Path, images: Path, options: Any, out: Path, start: Path | None = None
) -> Path | None:
    """Map, incrementally (from a model on disk, if given) or globally as the options are.

    Returns
    -------
    Path or None
        The folder of the largest model: a numbered one below ``out``, or of a continued model ``out`` itself.
        None if COLMAP builds none.
    """
    import pycolmap

    options.num_threads = 1
    out.mkdir()
    if isinstance(options, pycolmap.IncrementalPipelineOptions):
        models = pycolmap.incremental_mapping(database, images, out, options, str(start or ""))
    else:
        models = pycolmap.global_mapping(database, images, out, options)
    if not models:
        return None
    if start is not None:
        return out
    return out / str(max(models, key=lambda key: int(models[key].num_reg_images())))


def read_model(folder: Path | None) -> Model:
    """Read a model that COLMAP wrote; of none there are no poses."""
    import pycolmap

    if folder is None:
        return Model(poses={}, points=0, error_px=float("nan"))
    model = pycolmap.Reconstruction(folder)
    posed = {image.name: image.cam_from_world().matrix() for image in model.images.values() if image.has_pose}
    error_px = model.compute_mean_reprojection_error()
    return Model(poses=posed, points=model.num_points3D(), error_px=error_px)


def plain_options() -> Any:
    """COLMAP's own options, but for known intrinsics, a seed and the angle to begin with."""
    import pycolmap

    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = options.ba_refine_extra_params = False
    options.mapper.abs_pose_refine_focal_length = options.mapper.abs_pose_refine_extra_params = False
    options.random_seed = 0
    options.mapper.init_min_tri_angle = INITIAL_ANGLE_DEG
    return options


def link(database: Path, recording: Recording, model: Path | None) -> list[dict[str, Any]]:
    """Run ``blur2view to-colmap --link --sequence`` on every frame; give what its JSON says of each.

    Raises
    ------
    Blur2ViewError
        If the command fails.
    """
    arguments = ["to-colmap", "--db", database, "--link", "--no-backup", "--sequence", "--json"]
    arguments += ["--camera", f"{database}:1", *recording.paths]
    arguments += [] if model is None else ["--model", model]
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        code = blur2view_main([str(argument) for argument in arguments])
    if code != 0:
        raise Blur2ViewError(f"{database}: to-colmap ended with {code}; see above")
    photographs: list[dict[str, Any]] = json.loads(said.getvalue())["photographs"]
    return photographs


def estimated_motion(database: Path, names: Sequence[str]) -> Motion:
    """Read the motion of every photograph's open and close views from the database."""
    import pycolmap

    turns, moves = np.full((2, len(names), 3), np.nan)
    with pycolmap.Database.open(database) as opened:
        ids = {image.name: image.image_id for image in opened.read_all_images()}
        for k, name in enumerate(names):
            if name + OPEN not in ids:
                continue
            pose = opened.read_two_view_geometry(ids[name + OPEN], ids[name + CLOSE]).cam2_from_cam1
            if pose is not None:
                turns[k] = rotation_vector(pose.rotation.matrix())
                moves[k] = pose.translation
    return Motion(turns=turns, moves=moves)


def experiment(recording: Recording, model: Path | None, true_smears: bool = False) -> Result:
    """Reconstruct a recording without and with its views: those of a network, or of its true smears."""
    from blur2view.predict import SmearNetwork

    images = recording.paths[0].parent
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        database, linked = folder / "plain.db", folder / "linked.db"
        fresh_database(database, recording)
        without = run_mapper(database, images, plain_options(), folder / "without")
        shutil.copy(database, linked)
        if true_smears and recording.displacement is not None:
            facts = link_true(linked, recording.paths, recording.K, recording.displacement)
        else:
            facts = link(linked, recording, model)
        options = mapper_options(linked=True, keep_photographs=without is not None, refine_intrinsics=False)
        options.mapper.init_min_tri_angle = INITIAL_ANGLE_DEG
        joined = run_mapper(linked, images, options, folder / "joined", start=without)
        averaged = run_mapper(linked, images, global_options(refine_intrinsics=False), folder / "averaged")
        estimated = estimated_motion(linked, [path.name for path in recording.paths])
        models = [read_model(model) for model in (without, joined, averaged)]
    return Result(
        recording=recording,
        without=models[0],
        joined=models[1],
        averaged=models[2],
        estimated=estimated,
        facts=facts,
        model_id="true smears" if true_smears else f"network {SmearNetwork(model).info.model_id}",
    )


def markdown(result: Result) -> str:
    """Both tables of a recording."""
    photographs = len(result.names)
    joined, single = result.errors(result.motion), result.errors(result.estimated)
    registered = np.isfinite(joined.turn)
    known = np.array([bool(fact["time_known"]) for fact in result.facts])
    what = "the true one" if result.recording.exposure_known else "the frame interval"
    rows = [
        f"## {result.recording.name}: {photographs} frames, {result.model_id}",
        "",
        "| | without views | with views | with views, global mapping |",
        "|---|---|---|---|",
        *model_rows(result),
        "",
        f"Both views of {registered.sum()} photographs are registered; time direction called known for "
        f"{known.sum()}. Exposure over {what}: {result.exposure(result.motion):.3f} by the model's "
        f"rotations, {result.exposure(result.estimated):.3f} by those of single photographs.",
        "",
        "| motion during the exposure, median | photographs | rotation error | time direction right "
        "| translation's direction, degrees | translation error |",
        "|---|---|---|---|---|---|",
        motion_row("model with views", joined),
        *global_row(result),
        motion_row("single photographs", single, scaled=False),
        "",
        "| frame | configuration | usable | true rotation, degrees | model's error | single's | time right |",
        "|---|---|---|---|---|---|---|",
        *frame_rows(result, joined, single),
        "",
    ]
    return "\n".join(rows)


def model_rows(result: Result) -> list[str]:
    """Sizes and pose errors of the models."""
    columns = [model_column(result, model) for model in (result.without, result.joined, result.averaged)]
    labels = ["photographs registered", "views registered", "points", "reprojection error, px"]
    labels += ["median rotation error, degrees", "median position error, of the path's extent"]
    return [f"| {label} | {' | '.join(cells)} |" for label, *cells in zip(labels, *columns, strict=True)]


def model_column(result: Result, model: Model) -> list[str]:
    """Size and pose errors of a model."""
    if not model.poses:
        return ["0", "0", "0", "-", "-", "-"]
    extent = float(np.linalg.norm(np.ptp(centres(result.recording.poses), axis=0)))
    poses = model.of(result.names)
    seen = np.isfinite(poses).all(axis=(1, 2))
    aligned, true = result.alignment_of(model).poses(poses[seen]), result.recording.poses[seen]
    off = np.linalg.norm(centres(aligned) - centres(true), axis=1) / extent
    return [
        f"{seen.sum()}",
        f"{len(model.poses) - seen.sum()}",
        f"{model.points}",
        f"{model.error_px:.3f}",
        f"{np.median(rotation_errors_deg(aligned, true)):.3f}",
        f"{np.median(off):.2%}",
    ]


def global_row(result: Result) -> list[str]:
    """Motion by the model of global mapping, if there is one."""
    if not result.averaged.poses:
        return []
    return [motion_row("model with views, global mapping", result.errors(result.motion_of(result.averaged)))]


def motion_row(name: str, errors: MotionErrors, scaled: bool = True) -> str:
    """Give medians over the frames that have a motion; translations of single photographs have no length."""
    seen = np.isfinite(errors.turn)
    if not seen.any():
        return f"| {name} | 0 | - | - | - | - |"
    move = f"{np.median(errors.move[seen]):.0%}" if scaled else "-"
    return (
        f"| {name} | {seen.sum()} | {np.median(errors.turn[seen]):.1%} | {np.mean(errors.forward[seen]):.0%} "
        f"| {np.median(errors.heading_deg[seen]):.1f} | {move} |"
    )


def frame_rows(result: Result, joined: MotionErrors, single: MotionErrors) -> list[str]:
    """One row per photograph."""
    rows, true = [], np.degrees(np.linalg.norm(result.true_motion.turns, axis=1))
    facts = {fact["name"]: fact for fact in result.facts}
    for k, name in enumerate(result.names):
        fact = facts.get(name, {"config": "-", "num_matches": 0})
        cells = ["-" if np.isnan(e.turn[k]) else f"{e.turn[k]:.0%}" for e in (joined, single)]
        right = "-" if np.isnan(joined.forward[k]) else "yes" if joined.forward[k] else "no"
        rows.append(
            f"| {name} | {fact['config']} | {fact['num_matches']} | {true[k]:.2f} | {cells[0]} "
            f"| {cells[1]} | {right} |"
        )
    return rows


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sequence", type=Path, help="folder of tools.sequence")
    parser.add_argument("--redkitchen", type=Path, help="folder of redkitchen_sequence")
    parser.add_argument("--frames", type=int, help="only so many frames of each")
    parser.add_argument("--model", type=Path, help="ONNX file; the shipped one by default")
    parser.add_argument("--out", type=Path, help="write OUT.md and OUT.png")
    arguments = parser.parse_args()
    recordings = [] if arguments.sequence is None else [rendered_recording(arguments.sequence)]
    recordings += [] if arguments.redkitchen is None else [redkitchen_recording(arguments.redkitchen)]
    results = []
    for recording in recordings:
        for true_smears in (True, False) if recording.displacement is not None else (False,):
            results.append(experiment(recording.first(arguments.frames), arguments.model, true_smears))
            print(markdown(results[-1]), flush=True)
    text = "\n".join([HEADER, *(markdown(result) for result in results)])
    if arguments.out is not None:
        from tools.sfm_plot import plot

        arguments.out.with_suffix(".md").write_text(text)
        plot(results, arguments.out.with_suffix(".png"))


if __name__ == "__main__":
    main()
