"""The two-view geometry of one moving object: the camera's estimator on the object's own smears."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.pipeline import Estimate
from blur2view.smears.field import SmearField
from blur2view.smears.selection import SelectOptions, select_matches
from blur2view.two_view.estimate import estimate_two_view
from blur2view.two_view.options import EstimatorOptions

INSIDE_PX = 8  # a smear nearer to the rim is mixed with what lies behind
ELSEWHERE_PX = 1000.0  # sigma of smears that are not the object's


def object_motion(
    found: Estimate,
    inside: NDArray[np.bool_],
    options: EstimatorOptions | None = None,
    rng: np.random.Generator | None = None,
) -> TwoViewGeometry:
    """Estimate how an object moved with respect to the camera.

    Parameters
    ----------
    found : Estimate
        Of the whole photograph.
    inside : ndarray of bool, shape (H, W)
        The object's pixels.
    options : EstimatorOptions, optional
        Of them the limits on how much of the image smears cover do not apply: an object is small.
    rng : numpy.random.Generator, optional
        ``default_rng(0)`` by default.

    Returns
    -------
    TwoViewGeometry
        F of the relative motion of object and camera, or a homography, or why there is neither: small
        objects mostly show no more than a homography.
    """
    field = found.field
    within = eroded(inside, INSIDE_PX)
    hidden = SmearField(
        displacement=np.where(within[..., None], field.displacement, 0),
        sigma_px=np.where(within, field.sigma_px, ELSEWHERE_PX).astype(np.float32),
        sigma_rad=field.sigma_rad,
    )
    matches = select_matches(hidden, SelectOptions(beta=1.0))
    own = replace(matches, still_share=0.0, sure_share=1.0)
    loose = replace(options or EstimatorOptions(), min_coverage=0.0)
    return estimate_two_view(own, loose, rng, found.camera)


def eroded(inside: NDArray[np.bool_], margin_px: int) -> NDArray[np.bool_]:
    """Take a margin off a mask (H, W); the photograph's own border is none."""
    from scipy.ndimage import distance_transform_edt

    return np.asarray(distance_transform_edt(inside) > margin_px)
