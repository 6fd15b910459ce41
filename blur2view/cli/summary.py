"""The summary of one photograph, as the commands print it: two lines, or everything."""

import math

import numpy as np

from blur2view.arrays import Array
from blur2view.cli.terminal import SHORT, printable
from blur2view.geometry.epipolar import epipoles
from blur2view.geometry.rotation import rotation_vector
from blur2view.geometry.two_view_geometry import Configuration, Parallax, TwoViewGeometry
from blur2view.output_files import ResultFiles
from blur2view.pipeline import Estimate
from blur2view.results.estimate import EstimateDocument
from blur2view.results.mask_overlay import mask_verdict
from blur2view.results.masks import MaskDocument
from blur2view.results.pose import PER_SECOND, BackwardDocument
from blur2view.results.verdicts import angle_sigma_rad
from blur2view.segmentation.mask import MotionMask

FAR_PX = 1e4  # an epipole that is farther away is given as a direction


def verdict_line(name: str, verdict: str, geometry: TwoViewGeometry) -> str:
    """Return the one sentence that matters of a photograph, then the configuration by COLMAP's name."""
    return f"{printable(name)}: {verdict} [{geometry.config.name}]"


def estimate_summary(
    document: EstimateDocument, estimate: Estimate, files: ResultFiles | None, verbosity: int = SHORT
) -> str:
    """Return two lines about one photograph, or everything, and where the results were written."""
    title = verdict_line(document.image, document.meaning, estimate.geometry)
    details = _details(document, estimate) if verbosity > SHORT else [_figures(document, estimate.geometry)]
    return _with_files([title, *details], files)


def mask_summary(
    document: MaskDocument, mask: MotionMask, files: ResultFiles | None, verbosity: int = SHORT
) -> str:
    """Return two lines about one photograph's mask, or everything."""
    lines = [f"{printable(document.image)}: {mask_verdict(mask)}"]
    if verbosity == SHORT:
        return _with_files([*lines, mask.reason.partition(";")[0]], files)
    lines.append(mask.reason)
    for region in mask.regions:
        x, y, width, height = region.box
        size = f"{region.area_px} px at ({x}, {y}), {width}x{height}"
        lines.append(f"{size}, moves with a probability of {region.probability:.2f}")
    return _with_files([*lines, *_seconds(document.timings_s)], files)


def _with_files(lines: list[str], files: ResultFiles | None) -> str:
    if files:
        endings = ",".join(ending.removeprefix(".") for ending in reversed(files.endings))
        name = printable(str(files.folder / files.stem))
        lines = [*lines[:-1], f"{lines[-1]}; wrote {name}.{{{endings}}}"]
    return "\n  ".join(lines)


def _figures(document: EstimateDocument, geometry: TwoViewGeometry) -> str:
    """Return one line: how many smears fit, the rotation or the epipole, the camera if it was scaled."""
    if geometry.F is None and geometry.H is None:
        return f"{document.num_matches} smears used"
    fit = f"{document.num_inliers} of {document.num_matches} smears fit"
    # beside H a share of F would read as certainty
    parts = [
        f"{fit} F, but H explains them, too"
        if geometry.F is not None and geometry.H is not None
        else f"{fit} ({_share(document)})"
    ]
    if document.cam2_from_cam1 is not None:
        parts.append(_rotation(document) + _missing_translation(document))
        if document.rate_unit == PER_SECOND:
            parts.append(rate(document))
    elif geometry.F is not None and geometry.H is None:
        epipole = f"moved to or from the epipole at {_point(epipoles(geometry.F)[0])}"
        parts.append(epipole if document.readout_s else f"{epipole}, if the shutter is global")
    if document.camera is not None and "scaled" in document.camera.source:
        parts.append(document.camera.source)
    return "; ".join(parts)


def _share(document: EstimateDocument) -> str:
    """Return the share of the smears that fit, rounded down: not all are 100%."""
    share = 100 * document.num_inliers // max(document.num_matches, 1)
    return f"{share}%, {100 * document.support_by_chance:.0f}% would by chance"


def _details(document: EstimateDocument, estimate: Estimate) -> list[str]:
    """Return everything: the reason, the smears, F, H, E, epipoles, pose, costs of the models, timings."""
    geometry, matches = estimate.geometry, estimate.matches
    used = f"{document.width}x{document.height} pixels, {document.num_matches} smears used"
    if len(matches):
        length, sigma = np.median(matches.length_px), np.median(matches.sigma_px)
        used += f", of median length {length:.1f} px, uncertain to {sigma:.1f} px"
    if geometry.F is not None or geometry.H is not None:
        used += f"; {document.num_inliers} fit"
    lines = [geometry.reason, used]
    for name, matrix in (("F", geometry.F), ("H", geometry.H), ("E", geometry.E)):
        lines += [] if matrix is None else _matrix_lines(name, matrix)
    if geometry.F is not None and geometry.H is None:  # beside H they would read as certain
        lines.append("epipoles " + " and ".join(_point(epipole) for epipole in epipoles(geometry.F)))
    lines += _pose_lines(document)
    if document.camera is not None:
        lines.append(f"intrinsics: {document.camera.source}{'' if document.camera.known else ', a hint'}")
    if document.scores:
        costs = ", ".join(f"{name} {cost:.1f}" for name, cost in document.scores.items())
        lines.append(f"penalised costs: {costs}; {document.iterations} samples")
    lines += geometry.table.lines()
    return [*lines, *_seconds(document.timings_s)]


def _seconds(timings_s: dict[str, float] | None) -> list[str]:
    if timings_s is None:
        return []
    steps = ", ".join(f"{name} {seconds:.2f}" for name, seconds in timings_s.items())
    return [f"{sum(timings_s.values()):.2f} s ({steps})"]


def _rotation(document: EstimateDocument) -> str:
    deviation = ""
    if document.pose_covariance is not None:
        deviation = f" +/- {np.degrees(_angle_sigma(document)):.3f}"
    return f"rotation {document.rotation_deg:.3f}{deviation} degrees"


def _angle_sigma(document: EstimateDocument) -> float:
    """Return the standard deviation of the rotation's angle, radians: that along its axis."""
    pose, covariance = document.cam2_from_cam1, document.pose_covariance
    if pose is None or covariance is None:
        return math.nan
    return angle_sigma_rad(rotation_vector(np.array(pose.rotation)), np.array(covariance.matrix))


def rate(document: EstimateDocument) -> str:
    """Return the angular velocity, also that of the other order in time if a rolling shutter has another."""
    known = float(np.linalg.norm(_vector(document)))
    sigma = _angle_sigma(document) / (document.exposure_s or 1.0)
    text = f"{known:.3g} +/- {sigma:.2g} rad/s{' (may be none)' if known < sigma else ''}"
    if document.backward is not None and not document.time_known:
        text += f" or, in the other order in time, {np.linalg.norm(_vector(document.backward)):.3g} rad/s"
    return text


def _vector(document: EstimateDocument | BackwardDocument) -> list[float]:
    """Return the rate about x, y and z; zero without a pose."""
    return [document.wx or 0.0, document.wy or 0.0, document.wz or 0.0]


def _missing_translation(document: EstimateDocument) -> str:
    """Return why a pose's translation is zero; nothing if it is not."""
    if document.cam2_from_cam1 is None or any(document.cam2_from_cam1.translation):
        return ""
    turned = document.config == Configuration.PANORAMIC.name and document.parallax == Parallax.ABSENT
    return ", no translation" if turned else ", translation unknown"


def _pose_lines(document: EstimateDocument) -> list[str]:
    """Return rotation and translation with their standard deviations, up to the flip of time."""
    pose, covariance = document.cam2_from_cam1, document.pose_covariance
    if pose is None:
        return []
    rotation = _rotation(document)
    if document.rate_unit == PER_SECOND:
        rates = ", ".join(f"{rate:z.3f}" for rate in _vector(document))
        rotation += f", angular velocity ({rates}) rad/s in {document.exposure_s:g} s, {rate(document)}"
    if not any(pose.translation):
        return [rotation + _missing_translation(document)]
    direction = ", ".join(f"{value:z.3f}" for value in pose.translation)
    translation = f"translation towards ({direction})"
    if covariance is not None:
        translation += f" (+/- {covariance.translation_sigma_deg:.1f} degrees)"
    return [f"{rotation}; {translation}"]


def _matrix_lines(name: str, matrix: Array) -> list[str]:
    rows = ["  ".join(f"{value: .6e}" for value in row) for row in matrix]
    return [f"{f'{name} = ' if index == 0 else '    '}{row}" for index, row in enumerate(rows)]


def _point(epipole: Array) -> str:
    """Return where an epipole lies in the photograph, or its direction if it is far away."""
    x, y, w = epipole
    if abs(w) * FAR_PX > np.hypot(x, y):
        return f"({x / w:z.0f}, {y / w:z.0f})"
    return f"infinity at {np.degrees(np.arctan2(y, x)) % 180:.0f} degrees"
