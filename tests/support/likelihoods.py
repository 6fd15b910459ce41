"""Likelihoods of smears in normalised coordinates, as tests of formulas want them."""

from dataclasses import replace

import numpy as np

from blur2view.arrays import Array
from blur2view.smears.matches import SmearMatches
from blur2view.smears.noise import NoiseModel
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.models import assumed_camera
from tests.support.scenes import IMAGE_SIZE

T = assumed_camera(IMAGE_SIZE)
UNIT_PX = 1 / T[0, 0]
PLAIN = NoiseModel(least=0.0, least_along=0.0, least_across=0.0)


def normalised_likelihood(ends: Array, sigma: float | Array, effective_share: float = 1.0) -> Likelihood:
    """Return that of ends (N, 2, 2) whose Sampson distances have a standard deviation, both normalised."""
    pixels = (np.asarray(ends) - T[:2, 2]) / np.diag(T)[:2]
    sigma_px = np.broadcast_to(2 * UNIT_PX * np.asarray(sigma), len(ends))
    shared = replace(PLAIN, effective_share=effective_share)
    matches = SmearMatches(ends=pixels, sigma_px=sigma_px, image_size=IMAGE_SIZE, shared=shared)
    return Likelihood.of(matches)
