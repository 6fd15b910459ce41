"""The summary of one photograph, as the commands print it: two lines, or everything."""

import numpy as np

from blur2view.arrays import Array
from blur2view.cli.terminal import SHORT, printable
from blur2view.geometry.epipolar import epipoles
from blur2view.geometry.two_view_geometry import Configuration, Parallax, TwoViewGeometry
from blur2view.output_files import ResultFiles
from blur2view.pipeline import Estimate
from blur2view.results.estimate import EstimateDocument
from blur2view.results.mask_overlay import mask_verdict
from blur2view.results.masks import MaskDocument
from blur2view.results.pose import PER_SECOND
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
    details = _details(document, estimate) if verbosity > SHORT else [_figures(document, estimate)]
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


def _figures(document: EstimateDocument, estimate: Estimate) -> str:
    """Return one line: how many smears fit, the rotation or the epipole, the camera if it was scaled."""
    geometry = estimate.geometry
    if geometry.F is None and geometry.H is None:
        return f"{document.num_matches} smears used"
    fit = f"{document.num_inliers} of {document.num_matches} smears fit"
    # beside H a share of F would read as certainty
    both = geometry.F is not None and geometry.H is not None
    parts = [f"{fit} F, but H explains them, too" if both else f"{fit} ({_share(document)})"]
    if geometry.cam2_from_cam1 is not None:
        parts.append(_rotation(document, geometry) + _missing_translation(geometry))
        if document.rate_unit == PER_SECOND:
            parts.append(_rate(document, geometry))
    elif geometry.F is not None and geometry.H is None:
        epipole = f"moved to or from the epipole at {_point(epipoles(geometry.F)[0])}"
        parts.append(epipole if document.readout_s else f"{epipole}, if the shutter is global")
    if estimate.camera is not None and "scaled" in estimate.camera.source:
        parts.append(estimate.camera.source)
    return "; ".join(parts)


def _share(document: EstimateDocument) -> str:
    """Return the share of the smears that fit, rounded down: not all are 100%."""
    share = 100 * document.num_inliers // max(document.num_matches, 1)
    return f"{share}%, {100 * document.support_by_chance:.0f}% would by chance"


def _details(document: EstimateDocument, estimate: Estimate) -> list[str]:
    """Return everything: the reason, the smears, F, H, E, epipoles, pose, costs of the models, timings."""
    geometry, matches, camera = estimate.geometry, estimate.matches, estimate.camera
    used = f"{document.width}x{document.height} pixels, {document.num_matches} smears used"
    if len(matches):
        length, sigma = np.median(matches.length_px), np.median(matches.sigma_px)
        used += f", of median length {length:.1f} px, uncertain to {sigma:.1f} px"
    if geometry.F is not None or geometry.H is not None:
        used += f"; {document.num_inliers} fit"
    lines = [geometry.reason, used]
    for name, matrix in (("F", geometry.F), ("H", geometry.H), ("E", geometry.E)):
        rows = ["  ".join(f"{value: .6e}" for value in row) for row in (() if matrix is None else matrix)]
        lines += [f"{f'{name} = ' if index == 0 else '    '}{row}" for index, row in enumerate(rows)]
    if geometry.F is not None and geometry.H is None:  # beside H they would read as certain
        lines.append("epipoles " + " and ".join(_point(epipole) for epipole in epipoles(geometry.F)))
    lines += _pose_lines(document, geometry)
    if camera is not None:
        lines.append(f"intrinsics: {camera.source}{'' if camera.known else ', a hint'}")
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


def _rotation(document: EstimateDocument, geometry: TwoViewGeometry) -> str:
    deviation = f" +/- {np.degrees(angle_sigma_rad(geometry)):.3f}" if geometry.covariance else ""
    return f"rotation {document.rotation_deg:.3f}{deviation} degrees"


def _rate(document: EstimateDocument, geometry: TwoViewGeometry) -> str:
    """Return the angular velocity, also that of the other order in time if a rolling shutter has another."""
    exposure_s = document.exposure_s or 1.0
    known, sigma = _speed(geometry, exposure_s), angle_sigma_rad(geometry) / exposure_s
    text = f"{known:.3g} +/- {sigma:.2g} rad/s{' (may be none)' if known < sigma else ''}"
    if document.backward is not None and geometry.backward is not None and not document.time_known:
        other = _speed(geometry.backward, exposure_s)
        text += f" or, in the other order in time, {other:.3g} rad/s"
    return text


def _speed(geometry: TwoViewGeometry, exposure_s: float) -> float:
    velocity = geometry.angular_velocity(exposure_s)
    return 0.0 if velocity is None else float(np.linalg.norm(velocity.mean))


def _missing_translation(geometry: TwoViewGeometry) -> str:
    """Return why a pose's translation is zero; nothing if it is not."""
    if geometry.cam2_from_cam1 is None or geometry.cam2_from_cam1.translation.any():
        return ""
    turned = geometry.config is Configuration.PANORAMIC and geometry.parallax is Parallax.ABSENT
    return ", no translation" if turned else ", translation unknown"


def _pose_lines(document: EstimateDocument, geometry: TwoViewGeometry) -> list[str]:
    """Return rotation and translation with their standard deviations, up to the flip of time."""
    pose, covariance = geometry.cam2_from_cam1, geometry.covariance
    if pose is None:
        return []
    line = _rotation(document, geometry)
    if document.rate_unit == PER_SECOND:
        rates = ", ".join(f"{rate or 0.0:z.3f}" for rate in (document.wx, document.wy, document.wz))
        speed = _rate(document, geometry)
        line += f", angular velocity ({rates}) rad/s in {document.exposure_s:g} s, {speed}"
    if missing := _missing_translation(geometry):
        return [line + missing]
    direction = ", ".join(f"{value:z.3f}" for value in pose.translation)
    line += f"; translation towards ({direction})"
    return [line + (f" (+/- {covariance.translation_sigma_deg:.1f} degrees)" if covariance else "")]


def _point(epipole: Array) -> str:
    """Return where an epipole lies in the photograph, or its direction if it is far away."""
    x, y, w = epipole
    if abs(w) * FAR_PX > np.hypot(x, y):
        return f"({x / w:z.0f}, {y / w:z.0f})"
    return f"infinity at {np.degrees(np.arctan2(y, x)) % 180:.0f} degrees"
