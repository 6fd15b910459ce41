"""The summary of one photograph, as the commands print it: two lines, or everything."""

import numpy as np

from blur2view.arrays import Array
from blur2view.cli.terminal import printable
from blur2view.geometry.epipolar import epipoles
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.output_files import ResultFiles
from blur2view.results.estimate import PER_SECOND, EstimateDocument
from blur2view.results.mask_overlay import mask_verdict
from blur2view.results.masks import MaskDocument
from blur2view.segmentation.mask import MotionMask

AXES = ("wx", "wy", "wz")
FAR_PX = 1e4  # an epipole that is farther away is given as a direction


def verdict_line(name: str, verdict: str, geometry: TwoViewGeometry) -> str:
    """Return the one sentence that matters of a photograph, then the configuration by COLMAP's name."""
    return f"{printable(name)}: {verdict} [{geometry.config.name}]"


def estimate_summary(
    document: EstimateDocument, geometry: TwoViewGeometry, files: ResultFiles | None, *, verbose: bool
) -> str:
    """Return two lines about one photograph, or everything, and where the results were written."""
    lines = [verdict_line(document.image, document.meaning, geometry), _figures(document, geometry)]
    if verbose:
        lines += [document.reason, *_details(document), *geometry.table.lines(), *_seconds(document)]
    return _with_files(lines, files)


def mask_summary(
    document: MaskDocument, mask: MotionMask, files: ResultFiles | None, *, verbose: bool
) -> str:
    """Return two lines about one photograph's mask, or everything."""
    lines = [f"{printable(document.image)}: {mask_verdict(mask)}"]
    if not verbose:
        return _with_files([*lines, mask.reason.partition(";")[0]], files)
    lines.append(mask.reason)
    for region in mask.regions:
        x, y, width, height = region.box
        size = f"{region.area_px} px at ({x}, {y}), {width}x{height}"
        lines.append(f"{size}, moves with a probability of {region.probability:.2f}")
    return _with_files([*lines, *_seconds(document)], files)


def _with_files(lines: list[str], files: ResultFiles | None) -> str:
    if files:
        endings = ",".join(ending.removeprefix(".") for ending in reversed(files.endings))
        name = printable(str(files.folder / files.stem))
        lines = [*lines[:-1], f"{lines[-1]}; wrote {name}.{{{endings}}}"]
    return "\n  ".join(lines)


def _figures(document: EstimateDocument, geometry: TwoViewGeometry) -> str:
    """Return one line: how many smears fit, without a pose the epipole, the camera if it was scaled."""
    if document.F is None and document.H is None:
        return f"{document.num_matches} smears used"
    fit = f"{document.num_inliers} of {document.num_matches} smears fit"
    share = 100 * document.num_inliers // max(document.num_matches, 1)  # rounded down: not all are 100%
    by_chance = f"{share}%, {100 * document.support_by_chance:.0f}% would by chance"
    # beside H a share of F would read as certainty
    both = document.F is not None and document.H is not None
    parts = [f"{fit} F, but H explains them, too" if both else f"{fit} ({by_chance})"]
    if geometry.F is not None and document.H is None and document.cam2_from_cam1 is None:
        epipole = f"moved to or from the epipole at {_point(epipoles(geometry.F)[0])}"
        parts.append(epipole if document.readout_s else f"{epipole}, if the shutter is global")
    if document.camera is not None and "scaled" in document.camera["source"]:
        parts.append(document.camera["source"])
    return "; ".join(parts)


def _details(document: EstimateDocument) -> list[str]:
    """Return F, H, E, the pose, the intrinsics and the costs of the families, as far as there are such."""
    lines = []
    for name in ("F", "H", "E"):
        rows = ["  ".join(f"{value: .6e}" for value in row) for row in getattr(document, name) or ()]
        lines += [f"{name} = {row}" if index == 0 else f"    {row}" for index, row in enumerate(rows)]
    pose, covariance, backward = document.cam2_from_cam1, document.pose_covariance, document.backward
    if pose is not None:
        what = "angular velocity" if document.rate_unit == PER_SECOND else "rotation"
        line = f"{what} {_vector([getattr(document, axis) for axis in AXES])} {document.rate_unit}"
        if backward is not None and not document.time_known:
            line += f" or, in the other order in time, {_vector([backward[axis] for axis in AXES])}"
        if any(pose["translation"]):
            line += f"; translation towards {_vector(pose['translation'])}"
            line += f" (+/- {covariance['translation_sigma_deg']:.1f} degrees)" if covariance else ""
        lines.append(line)
    if document.camera is not None:
        hint = "" if document.camera["known"] else ", a hint"
        lines.append(f"intrinsics: {document.camera['source']}{hint}")
    if document.scores:
        costs = ", ".join(f"{name} {cost:.1f}" for name, cost in document.scores.items())
        lines.append(f"penalised costs: {costs}; {document.iterations} samples")
    return lines


def _vector(values: list[float]) -> str:
    return f"({', '.join(f'{value:z.3f}' for value in values)})"


def _seconds(document: EstimateDocument | MaskDocument) -> list[str]:
    if document.timings_s is None:
        return []
    steps = ", ".join(f"{name} {seconds:.2f}" for name, seconds in document.timings_s.items())
    return [f"{sum(document.timings_s.values()):.2f} s ({steps})"]


def _point(epipole: Array) -> str:
    """Return where an epipole lies in the photograph, or its direction if it is far away."""
    x, y, w = epipole
    if abs(w) * FAR_PX > np.hypot(x, y):
        return f"({x / w:z.0f}, {y / w:z.0f})"
    return f"infinity at {np.degrees(np.arctan2(y, x)) % 180:.0f} degrees"
