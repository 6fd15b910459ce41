"""A few readable lines about one photograph, as the commands print them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.cli.outputs import MaskFiles, OutputFiles
from blur2view.geometry.epipolar import epipoles
from blur2view.pipeline import Estimate
from blur2view.segmentation.mask import MotionMask
from blur2view.visualization.mask_overlay import headline


def mask_summary(facts: dict[str, Any], mask: MotionMask, files: MaskFiles | None) -> str:
    """Return a few readable lines about one photograph's mask."""
    lines = [f"{facts['image']}: {headline(mask)}", mask.reason]
    for region in mask.regions:
        x, y, width, height = region.box
        line = f"{region.area_px} px at ({x}, {y}), {width}x{height}, score {region.score:.1f}"
        lines.append(f"{line}; {region.reason}" if region.reason else line)
    lines.append(f"{sum(facts['timings_s'].values()):.2f} s")
    if files:
        lines[-1] += f"; wrote {', '.join(str(path) for path in reversed(files.paths))}"
    return "\n  ".join(lines)


def summary(facts: dict[str, Any], estimate: Estimate, files: OutputFiles | None) -> str:
    """Return a few readable lines about one photograph.

    Parameters
    ----------
    facts : dict
        From :func:`document`.
    estimate : Estimate
        What was found.
    files : OutputFiles, optional
        Where the results were written, if they were.
    """
    geometry, matches = estimate.geometry, estimate.matches
    used = f"{facts['num_matches']} smears used"
    if len(matches):
        length, sigma = np.median(matches.length_px), np.median(matches.sigma_px)
        used += f", median length {length:.1f} px, sigma {sigma:.1f} px"
    title = f"{facts['image']}: {geometry.config.name} ({facts['width']}x{facts['height']})"
    lines = [title, geometry.reason, used]
    if geometry.F is not None:
        share = facts["num_inliers"] / max(len(matches), 1)
        lines[-1] += f"; {facts['num_inliers']} ({share:.0%}) are inliers"
        lines += _matrix_lines(geometry.F)
        lines.append("epipoles " + " and ".join(_point(epipole) for epipole in epipoles(geometry.F)))
    lines += _pose_lines(facts)
    lines.append(f"{sum(facts['timings_s'].values()):.2f} s")
    if files:
        lines[-1] += f"; wrote {', '.join(str(path) for path in reversed(files.paths))}"
    return "\n  ".join(lines)


def _pose_lines(facts: dict[str, Any]) -> list[str]:
    """Return rotation and translation with their standard deviations, up to the flip of time."""
    pose, covariance = facts["cam2_from_cam1"], facts["pose_covariance"]
    if pose is None:
        return []
    turned = f"rotation {facts['rotation_deg']:.3f} degrees"
    if covariance is not None:
        turned += f" (sigma {max(covariance['rotation_sigma_deg']):.3f})"
    if facts["angular_velocity_rad_s"] is not None:
        rates = ", ".join(f"{rate:.3f}" for rate in facts["angular_velocity_rad_s"])
        turned += f", angular velocity ({rates}) rad/s in {facts['exposure_s']:g} s"
    if not any(pose["translation"]):
        return [turned + ", no translation"]
    direction = ", ".join(f"{value:.3f}" for value in pose["translation"])
    moved = f"translation towards ({direction})"
    if covariance is not None:
        moved += f" (sigma {covariance['translation_sigma_deg']:.1f} degrees)"
    return [f"{turned}; {moved}"]


def _matrix_lines(F: NDArray[np.float64]) -> list[str]:
    """Return F as three aligned rows."""
    rows = ["  ".join(f"{value: .6e}" for value in row) for row in F]
    return [f"{'F = ' if index == 0 else '    '}{row}" for index, row in enumerate(rows)]


def _point(epipole: NDArray[np.float64]) -> str:
    """Return where an epipole lies in the photograph, or its direction if it is far away."""
    x, y, w = epipole
    if abs(w) * 1e5 > np.hypot(x, y):  # within 100,000 px
        return f"({x / w:.0f}, {y / w:.0f})"
    return f"at infinity towards {np.degrees(np.arctan2(y, x)) % 180:.0f} degrees"
