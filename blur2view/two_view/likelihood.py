"""The likelihood of F given smears whose order is unknown, and the errors by which every model is judged.

F says on which line a smear lies, not where on it, so a residual is a Sampson distance. (The displacement
field of a rotation or a plane says where both ends are: `homography.FieldLikelihood`.) How large errors are
along a smear and across it is stated by `smears.noise`. The likelihood of a smear is the sum over its two
orders and over being an outlier. Smears that overlap err together: the log-likelihood of n smears is
multiplied by the share of them that is independent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.camera import Camera
from blur2view.geometry.epipolar import EndProducts
from blur2view.smears.matches import SmearMatches
from blur2view.smears.noise import ACROSS_SHARE
from blur2view.two_view import constants as c
from blur2view.two_view.models import assumed_camera, velocity_basis

PROBIT_AS_LOGIT = 1.702  # log(Phi(z)) is -log(1 + exp(-1.702 z)) to within 0.01 in Phi
MAX_LOG_ODDS = 300.0  # against an order: two such make no number that is too small


@dataclass(frozen=True, kw_only=True, eq=False)
class OrderedResiduals:
    """Residuals of every smear in both orders, in standard deviations, and what follows from them.

    ``both`` (2, N) are the residuals of ends[:, 0] first and of ends[:, 1] first; ``order_prior`` is the
    probability of both orders before looking at the residuals: 1/2, or (2, N) by positive depth
    (`order_odds`). With 1/2 each, deciding an order costs 2 log 2 and is only worth it where the residuals of
    the orders differ by more than the noise. ``root`` (2, N) is the length of the gradient, kept for the
    derivatives; ``chance`` (N,) the density of an outlier's residual over that of an inlier's at zero, times
    the odds of being an outlier.
    """

    both: Array
    root: Array
    chance: Array
    order_prior: Array | float = 0.5

    @cached_property
    def backward(self) -> NDArray[np.bool_]:
        """Where ends[:, 1] first is the better order, (N,)."""
        return np.asarray(np.abs(self.both[1]) < np.abs(self.both[0]))

    @property
    def least(self) -> Array:
        """Absolute residuals (N,) of the better order."""
        return np.asarray(np.abs(self.both).min(axis=0))

    @property
    def forward_share(self) -> Array:
        """Posterior probability (N,) of the order ends[:, 0] first."""
        ahead, behind = np.log(self.order_prior) - 0.5 * self.both**2
        share: Array = 0.5 * (1 + np.tanh(0.5 * (ahead - behind)))
        return share

    @cached_property
    def likelihoods(self) -> Array:
        """Prior probability times likelihood (2, N) of both orders; their sum is at most 1."""
        return np.asarray(np.exp(-0.5 * self.both**2) * self.order_prior)

    @property
    def costs(self) -> Array:
        """Twice the negative log-likelihood (N,) of each smear, 0 for residuals of zero."""
        total = self.likelihoods.sum(axis=0) + self.chance
        return np.asarray(-2 * np.log(total / (1 + self.chance)))

    @property
    def weights(self) -> Array:
        """Probabilities (2, N) of being an inlier in either order: weights of least squares."""
        return np.asarray(self.likelihoods / (self.likelihoods.sum(axis=0) + self.chance))

    def decided(self) -> OrderedResiduals:
        """Return the residuals with the better order of each smear taken as certain, as SErrMin does."""
        return replace(self, order_prior=np.stack([~self.backward, self.backward]).astype(float))


@dataclass(frozen=True, kw_only=True, eq=False)
class NormalisedSmears:
    """Smears in normalised coordinates, T times pixels, with the standard deviations of their errors."""

    matches: SmearMatches  # of undistorted pixels, where the camera is known
    T: Array  # (3, 3): from pixels to normalised coordinates, K^-1 of the camera, assumed or given
    # standard deviations of the log focal length and of the principal point in focal lengths; 0: known
    lens_sigma: tuple[float, float]
    sigma_fitted: float = 1.0  # standard deviations of Sampson distances over those stated

    @classmethod
    def of(cls, matches: SmearMatches, camera: Camera | None = None) -> NormalisedSmears:
        """Return the smears of matches in undistorted pixels of the camera.

        Without a camera an ordinary one is assumed (`models.assumed_camera`), without an image size one whose
        picture just holds the ends.
        """
        if camera is not None:
            lens_sigma = camera.log_focal_sigma, 0.0 if camera.known else c.LENS_SIGMA[1]
            return cls(matches=matches, T=np.asarray(np.linalg.inv(camera.K), float), lens_sigma=lens_sigma)
        if matches.image_size is not None:
            return cls(matches=matches, T=assumed_camera(matches.image_size), lens_sigma=c.LENS_SIGMA)
        low, high = matches.ends.min(axis=(0, 1)), matches.ends.max(axis=(0, 1))
        T = assumed_camera(tuple(high - low + 1))
        T[:2, 2] -= T[0, 0] * low
        return cls(matches=matches, T=T, lens_sigma=c.UNSIZED_LENS_SIGMA)

    def __len__(self) -> int:
        return len(self.matches)

    @cached_property
    def ends(self) -> Array:
        """Ends (N, 2, 2), normalised."""
        return np.asarray(self.matches.ends * np.diag(self.T)[:2] + self.T[:2, 2])

    @cached_property
    def middle(self) -> Array:
        """Midpoints (N, 2) of the ends, normalised."""
        return np.asarray(0.5 * (self.ends[:, 0] + self.ends[:, 1]))

    @cached_property
    def displacement(self) -> Array:
        """Displacements ends[:, 1] - ends[:, 0], (N, 2), normalised."""
        return np.asarray(self.ends[:, 1] - self.ends[:, 0])

    @property
    def unit_px(self) -> float:
        """Pixels per normalised unit."""
        return float((self.T[0, 0] * self.T[1, 1]) ** -0.5)

    @cached_property
    def sigma_px(self) -> Array:
        """Standard deviations (N,) of the Sampson distance, pixels."""
        return np.asarray(self.matches.sampson_px * self.sigma_fitted)

    @property
    def sigma(self) -> Array:
        """Standard deviations (N,) of the Sampson distance, normalised."""
        return self.sigma_px / self.unit_px

    @cached_property
    def field_sigmas_px(self) -> Array:
        """Standard deviations (2, N) of the distance from a field along and across the smears, pixels.

        As stated; scaled as the residuals of F show where many smears err independently. F partly explains
        errors that neighbours share, so its residuals are smaller than the errors: a tenth of them on a
        phone's picture of a flat chart, which then seemed to have depth.
        """
        scale = self.sigma_fitted if self.effective_share == 1 and self.has_many_independent else 1.0
        matches = self.matches
        return scale * matches.shared.inlier_sigmas_px(matches.length_px, matches.sigma_px, matches.across_px)

    @property
    def effective_share(self) -> float:
        """Number of smears that would err independently over the number that there is."""
        return self.matches.shared.effective_share

    @property
    def effective_count(self) -> float:
        """Effective number of independent smears."""
        return self.effective_share * len(self)

    @property
    def has_many_independent(self) -> bool:
        """Whether MIN_INDEPENDENT smears are independent, so that residuals tell minima of the cost apart."""
        return self.effective_count >= c.MIN_INDEPENDENT

    @cached_property
    def prior_sigma(self) -> Array:
        """Prior standard deviations (6,) of rotation and intrinsics, given the median smear's length.

        Those of the head of `models`.
        """
        rotation = np.array(c.ROTATION_SPREAD) * float(np.median(self.matches.length_px)) / self.unit_px
        return np.array([*rotation, self.lens_sigma[0], self.lens_sigma[1], self.lens_sigma[1]])

    def rescaled(self, factor: float) -> NormalisedSmears:
        """Return the smears with the standard deviations of Sampson distances multiplied by a factor."""
        return replace(self, sigma_fitted=self.sigma_fitted * factor)

    def thinned(self, count: int) -> NormalisedSmears:
        """Return every n-th smear, ``count`` to 2 ``count`` of them; correlation stays."""
        step = max(1, len(self) // count)
        return replace(self, matches=self.matches.subset(slice(None, None, step)))

    @cached_property
    def fully_correlated(self) -> NormalisedSmears:
        """The same smears with all correlation of neighbours counted: for covariances, not for fits."""
        return replace(self, matches=replace(self.matches, shared=self.matches.shared.fully_correlated))

    @cached_property
    def products(self) -> EndProducts:
        """Products of the ends' coordinates, of which residuals are made."""
        return EndProducts(self.ends, self.sigma)

    @cached_property
    def chance(self) -> Array:
        """Density (N,) of an outlier's residual over an inlier's at zero, times the odds of an outlier."""
        density = np.minimum(np.pi**0.5 * self.sigma_px / (self.matches.length_px + TINY), 1)
        return np.asarray(c.OUTLIER_ODDS * density)

    def residuals(self, F: Array) -> OrderedResiduals:
        """Return the residuals of F (3, 3), of normalised coordinates; both orders are equally probable."""
        both, root = self.products.distances(F)
        return OrderedResiduals(both=both, root=root, chance=self.chance)

    @cached_property
    def _depths(self) -> tuple[Array, Array]:
        """Matrices (3, N) and (24, N) that t, and t times a generator's entries, are multiplied by.

        The products are the smears, and the displacements of the generator, along the epipolar lines of t.
        """
        basis = velocity_basis(self.middle).swapaxes(0, 1)  # (2, 8, N)
        flow = np.concatenate([self.displacement.T[:, None], basis], axis=1)
        along = np.concatenate([flow, -(self.middle.T[:, None] * flow).sum(axis=0, keepdims=True)])
        return along[:, 0], along[:, 1:].reshape(24, -1)

    def order_odds(self, rotation: Array, t: Array, sign: float) -> Array:
        """Return the probability (2, N) of both orders by positive depth.

        ``rotation`` (8,) are the entries of the rotation's generator; ``sign`` times ``t`` (3,) is the
        translation. Without the rotation a point p before the camera moves along t_12 - t_3 p: away from the
        epipole of a camera that goes forward, towards that of one that goes back. The probability that an
        order is feasible is that of its displacement along this direction, less that of the rotation, being
        positive. Only one order is feasible where the translation moves points farther than the rotation
        does. Where both are feasible they share the probability, so that a motion gains nothing by leaving
        orders open; where neither is, both are improbable. Errors that neighbours share mislead about depth
        as they do about F: the fewer smears are independent, the nearer both are to 1/2
        (`constants.DEPTH_TRUST`).
        """
        smear, flow = self._depths
        smeared, turned = t @ smear, np.outer(t, rotation).reshape(-1) @ flow
        x, y = self.middle.T
        length = np.sqrt((t[0] - t[2] * x) ** 2 + (t[1] - t[2] * y) ** 2) + TINY
        along = np.hypot(ACROSS_SHARE * self.sigma_px, c.LENGTH_ERROR * self.matches.length_px) / self.unit_px
        scale = sign * PROBIT_AS_LOGIT / (length * along)
        against = np.minimum(np.stack([turned - smeared, turned + smeared]) * scale, MAX_LOG_ODDS)
        feasible = 1 / (1 + np.exp(against))
        odds = feasible * (np.maximum(*feasible) / np.add(*feasible))
        weight = 1 / (1 + (c.DEPTH_TRUST / self.effective_share) ** 3)
        return np.asarray(odds**weight * 2 ** (weight - 1))
