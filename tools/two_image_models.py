"""Let COLMAP make models of two images, each from one blurred photograph, and compare its motion with ours.

    python -m tools.testset render/test --scenes 60 --photos KODAK
    python -m tools.two_image_models render/test --out tools/results/two_image_models

estimates each photograph with its intrinsics known, writes a database of its two virtual images as
``blur2view to-colmap`` does, and lets ``pycolmap.incremental_mapping`` reconstruct it under
`blur2view.mapping.mapper_options`. Photographs count whose median smear is longer than 12 px and whose
camera's translation makes more than a fifth of it. Told are the models that COLMAP builds, how far their
motion is from the estimate's in the estimate's own covariance, and both motions' errors against the truth;
then how many models are left if one option is COLMAP's again.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import blur2view
from blur2view.cameras import Camera
from blur2view.colmap_database import write_database
from blur2view.exposure_views import ExposureViews, views_of
from blur2view.geometry import TwoViewGeometry
from blur2view.mapping import mapper_options
from blur2view.pose import CHI_SQUARED_90, RigidTransform
from tools.testset import TestScene, read_test_set

LEAST_SMEAR_PX, LEAST_TRANSLATION = 12.0, 0.2
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
    """A motion against the true one, the nearer of both flips of time.

    ``rotation_deg`` is the angle between the rotations, ``rotation`` the same over the true angle,
    ``translation_deg`` the angle between the translations.
    """

    rotation_deg: float
    rotation: float
    translation_deg: float

    @classmethod
    def of(cls, pose: RigidTransform, true: RigidTransform) -> MotionError:
        """Compare two poses."""
        flip = min((true, true.inverse()), key=lambda flip: _apart_deg(pose, flip))
        apart = _apart_deg(pose, flip)
        cosine = float(np.clip(pose.translation @ flip.translation, -1, 1))
        return cls(
            rotation_deg=apart,
            rotation=apart / max(true.angle_deg, 1e-9),
            translation_deg=float(np.degrees(np.arccos(cosine))),
        )


def _apart_deg(pose: RigidTransform, true: RigidTransform) -> float:
    """Angle of the rotation between two poses, degrees."""
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
    """One photograph: its facts, its geometry, and COLMAP's model, None if there is none."""

    scene: TestScene
    views: ExposureViews
    model: Model | None

    @property
    def geometry(self) -> TwoViewGeometry:
        """Our estimate."""
        return self.views.geometry

    @property
    def true(self) -> RigidTransform:
        """The true motion, the translation of unit length."""
        return RigidTransform(rotation=self.scene.R, translation=self.scene.t / np.linalg.norm(self.scene.t))

    @property
    def distance(self) -> float | None:
        """Squared Mahalanobis distance of the model's motion from the estimate's, by its covariance."""
        pose, covariance = self.geometry.cam2_from_cam1, self.geometry.covariance
        if self.model is None or pose is None or covariance is None:
            return None
        return covariance.squared_distance(pose, self.model.pose)


def smear_px(scene: TestScene) -> float:
    """Median smear of the valid static pixels."""
    return float(np.median(np.linalg.norm(scene.displacement[scene.valid & scene.static], axis=-1)))


def translation_share(scene: TestScene) -> float:
    """Median length of what the rotation leaves of the true smears, over their own median length."""
    chosen = scene.valid & scene.static
    d = scene.displacement[chosen].astype(float)
    start = scene.midpoints[chosen] - d / 2
    turned = np.c_[start, np.ones(len(start))] @ (scene.K @ scene.R @ np.linalg.inv(scene.K)).T
    rest = d - (turned[:, :2] / turned[:, 2:] - start)
    return float(np.median(np.linalg.norm(rest, axis=1)) / np.median(np.linalg.norm(d, axis=1)))


def counts(scene: TestScene) -> bool:
    """Whether a photograph is one of those that COLMAP should reconstruct."""
    return smear_px(scene) > LEAST_SMEAR_PX and translation_share(scene) > LEAST_TRANSLATION


def estimate_views(scene: TestScene, network: blur2view.SmearNetwork) -> ExposureViews:
    """Estimate a photograph with its intrinsics known."""
    image = blur2view.read_image(scene.image_path)
    camera = Camera(K=scene.K, width=image.shape[1], height=image.shape[0])
    return views_of(scene.image_path.name, blur2view.estimate(image, network=network, camera=camera))


def reconstruct(views: ExposureViews, options: Any) -> Model | None:
    """Write a database of one exposure and run COLMAP's mapper on it; None if it builds no model of both."""
    import pycolmap

    options.num_threads = 1
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "exposure.db"
        write_database(path, [views])
        models = pycolmap.incremental_mapping(path, folder, folder, options)
    for model in models.values():
        posed = {image.name: image.cam_from_world() for image in model.images.values() if image.has_pose}
        if set(views.names) <= set(posed):
            motion = posed[views.names[1]] * posed[views.names[0]].inverse()
            return Model(
                points=model.num_points3D(),
                error_px=model.compute_mean_reprojection_error(),
                pose=unit_pose(motion),
            )
    return None


def unit_pose(motion: Any) -> RigidTransform:
    """Give a pycolmap.Rigid3d with its translation made of unit length."""
    length = np.linalg.norm(motion.translation)
    return RigidTransform(rotation=motion.rotation.matrix(), translation=motion.translation / length)


def with_default(name: str) -> Any:
    """Our options with one of them put back to COLMAP's default."""
    import pycolmap

    options, defaults = mapper_options(), pycolmap.IncrementalPipelineOptions()
    group, _, last = name.rpartition(".")
    ours, theirs = (getattr(o, group) if group else o for o in (options, defaults))
    setattr(ours, last, getattr(theirs, last))
    return options


def markdown(outcomes: Sequence[Outcome], left: dict[str, int], model_id: str) -> str:
    """All tables."""
    built = [o for o in outcomes if o.model is not None]
    posed = [o for o in built if o.distance is not None]
    within = sum(o.distance < CHI_SQUARED_90[5] for o in posed if o.distance is not None)
    rows = [
        f"Model {model_id}; {len(outcomes)} rendered photographs, median smear over {LEAST_SMEAR_PX:g} px, "
        f"translation over {LEAST_TRANSLATION:.0%} of it.",
        "",
        f"COLMAP reconstructs {len(built)} of {len(outcomes)}; the model's motion lies in the 90 % region of "
        f"the estimate's covariance for {within} of {len(posed)}.",
        "",
        "| median | rotation error, degrees | over the rotation | translation error, degrees |",
        "|---|---|---|---|",
        error_row("our estimate", [(o.geometry.cam2_from_cam1, o.true) for o in outcomes]),
        error_row("COLMAP's model", [(o.model.pose if o.model else None, o.true) for o in outcomes]),
        "",
        "| option put back to COLMAP's default | models left |",
        "|---|---|",
        *(f"| `{name}` | {count} |" for name, count in left.items()),
        "",
        "| photograph | smear, px | translation | configuration | points | error, px | distance^2 "
        "| rotation error | estimate's | translation error, degrees | estimate's |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
        *map(outcome_row, outcomes),
    ]
    return "\n".join(rows) + "\n"


def error_row(name: str, pairs: Sequence[tuple[RigidTransform | None, RigidTransform]]) -> str:
    """Medians over the photographs that have a pose."""
    errors = [MotionError.of(pose, true) for pose, true in pairs if pose is not None]
    if not errors:
        return f"| {name} | - | - | - |"
    turned, share, moved = np.median(
        [[e.rotation_deg, e.rotation, e.translation_deg] for e in errors], axis=0
    )
    return f"| {name} ({len(errors)}) | {turned:.3f} | {share:.2f} | {moved:.1f} |"


def outcome_row(o: Outcome) -> str:
    """One photograph."""
    pose, distance = o.geometry.cam2_from_cam1, o.distance
    head = f"| {o.scene.name} | {smear_px(o.scene):.1f} | {translation_share(o.scene):.2f} "
    head += f"| {o.geometry.config.name} "
    ours = None if pose is None else MotionError.of(pose, o.true)
    theirs = None if o.model is None else MotionError.of(o.model.pose, o.true)
    model = "| - | - " if o.model is None else f"| {o.model.points} | {o.model.error_px:.2f} "
    cells = [
        "-" if distance is None else f"{distance:.1f}",
        *("-" if e is None else f"{e.rotation:.2f}" for e in (theirs, ours)),
        *("-" if e is None else f"{e.translation_deg:.1f}" for e in (theirs, ours)),
    ]
    return f"{head}{model}| {' | '.join(cells)} |"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", type=Path, help="folder written by tools.testset")
    parser.add_argument("--model", type=Path, help="ONNX file; the shipped one by default")
    parser.add_argument("--out", type=Path, help="write OUT.md")
    arguments = parser.parse_args()
    network = blur2view.SmearNetwork(arguments.model)
    scenes = [scene for scene in read_test_set(arguments.scenes) if counts(scene)]
    outcomes = []
    for scene in scenes:
        views = estimate_views(scene, network)
        outcomes.append(Outcome(scene=scene, views=views, model=reconstruct(views, mapper_options())))
    left = {
        name: sum(reconstruct(o.views, with_default(name)) is not None for o in outcomes) for name in ALONE
    }
    text = markdown(outcomes, left, network.info.model_id)
    print(text)
    if arguments.out is not None:
        arguments.out.with_suffix(".md").write_text(text)


if __name__ == "__main__":
    main()
