"""Let COLMAP make models of two images, each from one blurred photograph, and compare its motion with ours.

    python -m tools.datasets.testset render/test --scenes 60 --photos KODAK
    python -m tools.reconstruction.two_image_models render/test --out tools/results/two_image_models

estimates each photograph with its intrinsics known, writes a database of its two virtual images as
``blur2view to-colmap`` does, and lets ``pycolmap.incremental_mapping`` reconstruct it under
`blur2view.colmap.mapping.mapper_options`. Photographs count whose median smear is longer than 12 px and whose
camera's translation makes more than a fifth of it. Reported are the models that COLMAP builds, how far their
motion is from the estimate's in the estimate's own covariance, and the errors of both against the truth;
the same where the smears' ends are first moved onto their epipolar lines (``to-colmap --corrected``), and
where the estimate's poses are kept (`blur2view.triangulate_exposure`); and how many models are left
if one option is COLMAP's again.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import blur2view
from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.colmap.database import write_database
from blur2view.colmap.mapping import mapper_options, triangulate_exposure
from blur2view.errors import DatabaseError
from blur2view.exposure.views import ExposureViews, views_of
from blur2view.geometry.pose import CHI_SQUARED_90, RigidTransform
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from tools.arguments import existing, parser_of, target
from tools.datasets.testset import TestScene, read_test_set

LEAST_SMEAR_PX, LEAST_TRANSLATION = 12.0, 0.2
STEADY_DEG = 0.2
"""True rotation below which its relative error means nothing."""
ALONE = (
    "mapper.init_max_error",
    "mapper.init_max_forward_motion",
    "mapper.init_min_num_inliers",
    "mapper.init_min_tri_angle",
    "mapper.filter_min_tri_angle",
    "triangulation.min_angle",
    "triangulation.ignore_two_view_tracks",
    "min_model_size",
)
"""Options of exposures alone, each of which is put back to COLMAP's default once."""


@dataclass(frozen=True, kw_only=True)
class MotionError:
    """A motion against the true one, the nearer of both time directions.

    ``rotation_deg`` is the angle between the rotations, ``rotation`` the same over the true angle (NaN if
    that is below `STEADY_DEG`), ``translation_deg`` the angle between the translations.
    """

    rotation_deg: float
    rotation: float
    translation_deg: float

    @classmethod
    def of(cls, pose: RigidTransform, true: RigidTransform) -> MotionError:
        """Return the errors of a pose; rotation and translation decide the time direction together."""
        turn = max(true.angle_deg, STEADY_DEG)
        found = min(
            (
                (_apart_deg(pose, flip), _between_deg(pose.translation, flip.translation))
                for flip in (true, true.inverse())
            ),
            key=lambda error: error[0] / turn + error[1] / 90,
        )
        relative = found[0] / true.angle_deg if true.angle_deg > STEADY_DEG else float("nan")
        return cls(rotation_deg=found[0], rotation=relative, translation_deg=found[1])

    @property
    def good(self) -> bool:
        """Return whether the rotation is right to 0.3 of itself or 0.2 degrees."""
        return self.rotation_deg < 0.2 or self.rotation < 0.3


def _between_deg(a: Array, b: Array) -> float:
    """Return the angle between unit vectors, degrees."""
    return float(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))


def _apart_deg(pose: RigidTransform, true: RigidTransform) -> float:
    """Return the angle of the rotation between two poses, degrees."""
    relative = RigidTransform(rotation=pose.rotation @ true.rotation.T, translation=np.zeros(3))
    return relative.angle_deg


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """What COLMAP made of one exposure."""

    points: int
    error_px: float
    pose: RigidTransform


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """One photograph: its facts, its geometry, and COLMAP's models, poses free and kept; None if none."""

    scene: TestScene
    views: ExposureViews
    model: Model | None
    corrected: Model | None
    kept: Model | None

    @property
    def geometry(self) -> TwoViewGeometry:
        """Return our estimate."""
        return self.views.geometry

    @property
    def true(self) -> RigidTransform:
        """Return the true motion, the translation of unit length."""
        return RigidTransform(rotation=self.scene.R, translation=self.scene.t / np.linalg.norm(self.scene.t))

    def distance(self, model: Model | None) -> float | None:
        """Return the squared Mahalanobis distance of a model's motion from the estimate's."""
        pose, covariance = self.geometry.cam2_from_cam1, self.geometry.covariance
        if model is None or pose is None or covariance is None:
            return None
        return covariance.squared_distance(pose, model.pose)


def smear_px(scene: TestScene) -> float:
    """Return the median smear of the valid static pixels."""
    return float(np.median(np.linalg.norm(scene.displacement[scene.valid & scene.static], axis=-1)))


def translation_share(scene: TestScene) -> float:
    """Return the median length of the true smears less their rotation, over their own median length."""
    chosen = scene.valid & scene.static
    d = scene.displacement[chosen].astype(float)
    start = scene.midpoints[chosen] - d / 2
    turned = np.c_[start, np.ones(len(start))] @ (scene.K @ scene.R @ np.linalg.inv(scene.K)).T
    rest = d - (turned[:, :2] / turned[:, 2:] - start)
    return float(np.median(np.linalg.norm(rest, axis=1)) / np.median(np.linalg.norm(d, axis=1)))


def counts(scene: TestScene) -> bool:
    """Return whether a photograph is one of those that COLMAP should reconstruct."""
    return smear_px(scene) > LEAST_SMEAR_PX and translation_share(scene) > LEAST_TRANSLATION


def estimate_views(scene: TestScene, network: blur2view.SmearNetwork) -> ExposureViews:
    """Return a photograph's views, estimated with its intrinsics known."""
    image = blur2view.read_image(scene.image_path)
    camera = Camera(K=scene.K, width=image.shape[1], height=image.shape[0])
    return views_of(scene.image_path.name, blur2view.estimate(image, network=network, camera=camera))


def reconstruct(views: ExposureViews, options: Any) -> Model | None:
    """Return the model of one exposure by COLMAP's mapper, None if it builds none of both views."""
    import pycolmap

    options.num_threads = 1
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "exposure.db"
        write_database(path, [views])
        models = pycolmap.incremental_mapping(path, folder, folder, options)
    found = (model_of(model, views) for model in models.values())
    return next((model for model in found if model is not None), None)


def keep_poses(views: ExposureViews) -> Model | None:
    """Return the model triangulated with the estimate's poses, None if there is no pose."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "exposure.db"
        write_database(path, [views])
        try:
            return model_of(triangulate_exposure(path, views.name), views)
        except DatabaseError:
            return None


def model_of(model: Any, views: ExposureViews) -> Model | None:
    """Return the poses of a pycolmap.Reconstruction of both views; None if one is missing, or all points."""
    posed = {image.name: image.cam_from_world() for image in model.images.values() if image.has_pose}
    if not set(views.names) <= set(posed) or model.num_points3D() == 0:
        return None
    motion = posed[views.names[1]] * posed[views.names[0]].inverse()
    points, error_px = model.num_points3D(), model.compute_mean_reprojection_error()
    return Model(points=points, error_px=error_px, pose=unit_pose(motion))


def unit_pose(motion: Any) -> RigidTransform:
    """Return a pycolmap.Rigid3d as ours, its translation scaled to unit length."""
    length = np.linalg.norm(motion.translation)
    return RigidTransform(rotation=motion.rotation.matrix(), translation=motion.translation / length)


def with_default(name: str) -> Any:
    """Return our options with one of them reset to COLMAP's default."""
    import pycolmap

    options, defaults = mapper_options(), pycolmap.IncrementalPipelineOptions()
    group, _, last = name.rpartition(".")
    ours, theirs = (getattr(o, group) if group else o for o in (options, defaults))
    setattr(ours, last, getattr(theirs, last))
    return options


def markdown(outcomes: Sequence[Outcome], left: dict[str, int], model_id: str) -> str:
    """Return all tables."""
    rows = [
        f"Model {model_id}; {len(outcomes)} rendered photographs, median smear over {LEAST_SMEAR_PX:g} px, "
        f"translation over {LEAST_TRANSLATION:.0%} of it.",
        "",
        "| | models of both views | in the 90 % region of the estimate's covariance "
        "| rotation error, degrees | over the rotation "
        "| to 0.3 or 0.2 degrees | translation error, degrees |",
        "|---|---|---|---|---|---|---|",
        summary_row("our estimate", outcomes, None),
        summary_row("COLMAP's model, `mapper_options()`", outcomes, [o.model for o in outcomes]),
        summary_row("the same of corrected ends, `--corrected`", outcomes, [o.corrected for o in outcomes]),
        summary_row("poses kept, `triangulate_exposure`", outcomes, [o.kept for o in outcomes]),
        "",
        "| option put back to COLMAP's default | models left |",
        "|---|---|",
        *(f"| `{name}` | {count} |" for name, count in left.items()),
        "",
        "| photograph | smear, px | translation | configuration | points | error, px | distance^2 "
        "| rotation error, degrees | estimate's | translation error, degrees | estimate's |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
        *map(outcome_row, outcomes),
    ]
    return "\n".join(rows) + "\n"


def summary_row(name: str, outcomes: Sequence[Outcome], models: Sequence[Model | None] | None) -> str:
    """Return counts, and medians over photographs with a motion: the estimate's, or those of models."""
    if models is None:
        poses, cells = [o.geometry.cam2_from_cam1 for o in outcomes], ["-", "-"]
    else:
        poses = [None if model is None else model.pose for model in models]
        distances = [o.distance(model) for o, model in zip(outcomes, models, strict=True)]
        known = [distance for distance in distances if distance is not None]
        within = sum(distance < CHI_SQUARED_90[5] for distance in known)
        cells = [f"{sum(pose is not None for pose in poses)} of {len(poses)}", f"{within} of {len(known)}"]
    pairs = zip(poses, outcomes, strict=True)
    errors = [MotionError.of(pose, o.true) for pose, o in pairs if pose is not None]
    return f"| {name} | {' | '.join([*cells, *medians(errors)])} |"


def medians(errors: Sequence[MotionError]) -> list[str]:
    """Return median rotation error (degrees; relative), share that is good, translation error (degrees)."""
    if not errors:
        return ["-"] * 4
    relative = [e.rotation for e in errors if not np.isnan(e.rotation)]
    return [
        f"{np.median([e.rotation_deg for e in errors]):.3f}",
        f"{np.median(relative):.2f}" if relative else "-",
        f"{np.mean([e.good for e in errors]):.0%}",
        f"{np.median([e.translation_deg for e in errors]):.1f}",
    ]


def outcome_row(o: Outcome) -> str:
    """Return the row of one photograph."""
    pose, distance = o.geometry.cam2_from_cam1, o.distance(o.model)
    head = f"| {o.scene.name} | {smear_px(o.scene):.1f} | {translation_share(o.scene):.2f} "
    head += f"| {o.geometry.config.name} "
    ours = None if pose is None else MotionError.of(pose, o.true)
    theirs = None if o.model is None else MotionError.of(o.model.pose, o.true)
    model = "| - | - " if o.model is None else f"| {o.model.points} | {o.model.error_px:.2f} "
    cells = [
        "-" if distance is None else f"{distance:.1f}",
        *("-" if e is None else f"{e.rotation_deg:.2f}" for e in (theirs, ours)),
        *("-" if e is None else f"{e.translation_deg:.1f}" for e in (theirs, ours)),
    ]
    return f"{head}{model}| {' | '.join(cells)} |"


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("scenes", type=existing, help="folder written by tools.datasets.testset")
    parser.add_argument("--model", type=existing, help="ONNX file; the shipped one by default")
    parser.add_argument("--out", type=target, help="write OUT.md")
    arguments = parser.parse_args()
    network = blur2view.SmearNetwork(arguments.model)
    scenes = [scene for scene in read_test_set(arguments.scenes) if counts(scene)]
    outcomes = []
    for scene in scenes:
        views = estimate_views(scene, network)
        free, kept = reconstruct(views, mapper_options()), keep_poses(views)
        corrected = reconstruct(views.corrected(), mapper_options())
        outcomes.append(Outcome(scene=scene, views=views, model=free, corrected=corrected, kept=kept))
    left = {
        name: sum(reconstruct(o.views, with_default(name)) is not None for o in outcomes) for name in ALONE
    }
    text = markdown(outcomes, left, network.info.model_id)
    print(text)
    if arguments.out is not None:
        arguments.out.with_suffix(".md").write_text(text)


if __name__ == "__main__":
    main()
