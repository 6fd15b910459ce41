"""One photograph's file to its estimate and the JSON documents: the step that all commands share."""

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.camera.camera import Camera
from blur2view.camera.exif import read_exif
from blur2view.camera.image import read_image
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import Estimate, Run, estimate
from blur2view.segmentation.mask import MotionLabel, MotionMask, MovingRegion

POSE_KEYS = ("E", "cam2_from_cam1", "rotation_deg", "angular_velocity_rad_s", "pose_covariance", "exposure_s")


@dataclass(frozen=True, kw_only=True, eq=False)
class FileEstimate:
    """What was found in one file.

    Parameters
    ----------
    path : Path
        As the user named it.
    image : ndarray of shape (H, W, 3), float32
        The photograph, upright.
    found : Estimate
        The smears and the geometry.
    facts : dict
        The JSON document of `documents.document`.
    """

    path: Path
    image: NDArray[np.float32]
    found: Estimate
    facts: dict[str, Any]


def estimate_file(path: Path, network: SmearNetwork, run: Run) -> FileEstimate:
    """Read a photograph and estimate its geometry, as ``blur2view estimate`` does.

    Parameters
    ----------
    path : Path
    network : SmearNetwork
    run : Run
        What was asked for. Each photograph has a generator of its own, so that its result does not depend
        on those before it.

    Raises
    ------
    ImageError, CameraError, ModelError
        If the file cannot be read, its camera not be had or the network not be run.
    """
    start = time.perf_counter()
    image = read_image(path)
    read_s = time.perf_counter() - start
    rng = np.random.default_rng(run.seed)
    exif = read_exif(path)
    camera = run.intrinsics.of(path, (image.shape[1], image.shape[0]), exif)
    found = estimate(image, network=network, select=run.select, options=run.options, rng=rng, camera=camera)
    facts = document(path, found.field.shape, found, run, read_s, run.exposure_s or exif.exposure_s)
    return FileEstimate(path=path, image=image, found=found, facts=facts)


def document(
    image: Path,
    size: tuple[int, int],
    estimate: Estimate,
    run: Run,
    read_s: float,
    exposure_s: float | None = None,
) -> dict[str, Any]:
    """Return the JSON document of one photograph.

    Parameters
    ----------
    image : Path
        As the user named it.
    size : tuple of int
        Height and width in pixels, after EXIF rotation.
    estimate : Estimate
        What was found.
    run : Run
        What was asked for.
    read_s : float
        Seconds spent on decoding.
    exposure_s : float, optional
        Exposure time in seconds.

    Returns
    -------
    dict
        Plain JSON types; the keys are part of the stable surface, and the README lists them.
    """
    geometry = estimate.geometry
    return {
        "image": str(image),
        "width": size[1],
        "height": size[0],
        "F": None if geometry.F is None else geometry.F.tolist(),
        "H": None if geometry.H is None else geometry.H.tolist(),
        "config": geometry.config.name,
        "reason": geometry.reason,
        "motion_model": geometry.model,
        "scores": dict(geometry.scores),
        "support": geometry.support,
        **camera_facts(estimate.camera),
        **pose_facts(geometry, exposure_s),
        "num_matches": len(estimate.matches),
        "num_inliers": int(np.count_nonzero(geometry.inlier_mask)),
        "iterations": geometry.iterations,
        "beta": run.select.beta,
        "max_error_px": run.options.max_error_px,
        "seed": run.seed,
        "model_id": estimate.model_id,
        "timings_s": {"read": read_s}
        | {k.removesuffix("_s"): v for k, v in asdict(estimate.timings).items()},
    }


def camera_facts(camera: Camera | None) -> dict[str, Any]:
    """Return the intrinsics that were used, for the JSON document."""
    if camera is None:
        return {"K": None, "camera": None}
    said = {"model": camera.model, "params": list(camera.params), "source": camera.source}
    return {"K": camera.K.tolist(), "camera": said | {"known": camera.known}}


def pose_facts(geometry: TwoViewGeometry, exposure_s: float | None) -> dict[str, Any]:
    """Return E, the pose, its covariance and its rates, for the JSON document; null where there are none."""
    pose, covariance = geometry.cam2_from_cam1, geometry.covariance
    facts: dict[str, Any] = dict.fromkeys(POSE_KEYS)
    facts["exposure_s"] = exposure_s
    if pose is None:
        return facts
    facts["cam2_from_cam1"] = {"rotation": pose.rotation.tolist(), "translation": pose.translation.tolist()}
    facts["rotation_deg"] = pose.angle_deg
    if geometry.E is not None:
        facts["E"] = geometry.E.tolist()
    if exposure_s is not None:
        facts["angular_velocity_rad_s"] = (pose.rotation_vector / exposure_s).tolist()
    if covariance is not None:
        facts["pose_covariance"] = {
            "matrix": covariance.matrix.tolist(),
            "tangents": covariance.tangents.tolist(),
            "rotation_sigma_deg": covariance.rotation_sigma_deg.tolist(),
            "translation_sigma_deg": covariance.translation_sigma_deg,
        }
    return facts


def mask_document(one: FileEstimate, mask: MotionMask, segment_s: float) -> dict[str, Any]:
    """Return the JSON document of one photograph's mask; the README lists its keys.

    Parameters
    ----------
    one : FileEstimate
    mask : MotionMask
        Of that photograph.
    segment_s : float
        Seconds that the mask took.
    """
    kept = ("image", "width", "height", "F", "H", "config")
    shares = {label.name.lower(): float((mask.labels == label).mean()) for label in MotionLabel}
    return {
        **{key: one.facts[key] for key in kept},
        "geometry_reason": one.facts["reason"],
        "reason": mask.reason,
        "labels": {label.name.lower(): int(label) for label in MotionLabel},
        "shares": shares,
        "regions": [region_facts(region) for region in mask.regions],
        "beta": one.facts["beta"],
        "max_error_px": one.facts["max_error_px"],
        "seed": one.facts["seed"],
        "model_id": one.facts["model_id"],
        "motion_model_id": mask.model_id or None,
        "timings_s": one.facts["timings_s"] | {"segment": segment_s},
    }


def region_facts(region: MovingRegion) -> dict[str, Any]:
    """Return a region in plain JSON types."""
    return {
        "area_px": region.area_px,
        "box": list(region.box),
        "centroid": list(region.centroid),
        "score": region.score,
        "F": None if region.F is None else region.F.tolist(),
        "H": None if region.H is None else region.H.tolist(),
        "reason": region.reason,
    }
