"""The pose of a camera whose intrinsics are known: a consistent fit of E, and its covariance.

`refine` returns the cheapest point it meets. Here the noise is estimated with the pose, by expectation-
maximisation: the scale of the standard deviations, the share of outliers, the order of every smear; and what
is returned is the point at rest, whose errors then have the covariance of an M-estimator.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from blur2view.epipolar import TINY, Array
from blur2view.estimators import SmearProblem
from blur2view.manifold import CameraF, TranslationF
from blur2view.pose import OrientedPose, PoseCovariance, oriented_pose, pose_covariance
from blur2view.refine import OrderedResiduals, RefineOptions, WeightedEnds, sampson_jacobian
from blur2view.seven_smears import plane_basis

POSE = 5  # of a camera's parameters, the first: two of t, three of R
STEPS, ROUGH_STEPS = 16, 6  # of expectation-maximisation, each with one Levenberg-Marquardt step
ROUGH_COUNT, STARTS = 500, 2  # smears, at least, and poses that are tried on them
AT_REST = 1e-3  # a step below this many standard deviations ends it
SCALES, ODDS = (0.03, 4.0), (0.01, 3.0)  # limits of the noise's scale, and of the odds of an outlier
CURVATURE_STEP = 0.3  # standard deviations over which the gradient is differenced
MISSED = 1.1  # the regions of white noise hold what they should with variances larger by this


@dataclass(frozen=True, kw_only=True)
class Noise:
    """The scale of the standard deviations, and the odds of being an outlier."""

    scale: float = 1.0
    outlier_odds: float = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedFit:
    """A pose at rest among its smears.

    ``point`` is the camera (its lens fixed), ``sign`` that of its translation, ``noise`` what was estimated
    with it, ``cost`` twice the negative log-posterior.
    """

    problem: SmearProblem
    point: CameraF
    sign: float
    noise: Noise
    options: RefineOptions

    @cached_property
    def matches(self) -> WeightedEnds:
        """The smears with the noise as estimated.

        An outlier's Sampson distance has the density 2^0.5 / (pi length) at zero: its direction is random.
        """
        given = self.problem.weighted
        sigma = given.sigma * self.noise.scale
        length = np.maximum(self.problem.length_px / self.problem.unit_px, TINY)
        chance = self.noise.outlier_odds * np.minimum(2 / np.pi**0.5 * sigma / length, 1.0)
        return replace(given, sigma=sigma, chance=chance)

    @cached_property
    def residuals(self) -> OrderedResiduals:
        """In both orders, with the odds of both."""
        plain = self.matches.residuals(self.point.matrix())
        return self.matches.weigh(plain, self.point, self.options.depth_weight, self.sign)

    @cached_property
    def inliers(self) -> Array:
        """Probabilities (N,) of being an inlier."""
        return self.matches.inlier_shares(self.residuals, self.options)

    @cached_property
    def order_weights(self) -> Array:
        """Probabilities (2, N) of being an inlier in one and in the other order."""
        share = self.residuals.forward_share
        weights: Array = self.inliers * np.stack([share, 1 - share])
        return weights

    @cached_property
    def both(self) -> Array:
        """Residuals (2, N) in both orders, in standard deviations."""
        return np.stack([self.residuals.forward, self.residuals.backward])

    def cost_at(self, point: CameraF) -> float:
        """Twice the negative log-posterior of another point, with the orders' odds of this one."""
        there = self.matches.residuals(point.matrix())
        there = replace(
            there, forward_log=self.residuals.forward_log, backward_log=self.residuals.backward_log
        )
        return self._cost(point, there)

    @property
    def cost(self) -> float:
        """Twice the negative log-posterior, of the noise too."""
        noise = 2 * np.log(self.noise.scale * (1 + self.noise.outlier_odds)) * len(self.inliers)
        chance = -2 * np.log1p(np.asarray(self.matches.chance)).sum()  # costs are 0 for a perfect inlier
        return self._cost(self.point, self.residuals) + self.options.data_weight * float(noise + chance)

    def _cost(self, point: CameraF, residuals: OrderedResiduals) -> float:
        prior, _ = point.prior()
        data = self.matches.costs(residuals, self.options).sum()
        return float(self.options.data_weight * data + prior @ prior)

    @cached_property
    def _derivatives(self) -> tuple[Array, Array, Array]:
        """Gradients (POSE, N) of half the cost by smear, normal matrices (POSE, POSE) of data and prior."""
        F, tangent = self.point.matrix(), self.point.tangent().reshape(-1, 9)[:POSE]
        gradient, normal = np.zeros((POSE, len(self.inliers))), np.zeros((POSE, POSE))
        ends = self.problem.ends
        for first, second, weight, residual in (
            (ends[:, 0], ends[:, 1], self.order_weights[0], self.both[0]),
            (ends[:, 1], ends[:, 0], self.order_weights[1], self.both[1]),
        ):
            J = tangent @ sampson_jacobian(F, first, second).reshape(-1, 9).T / self.matches.sigma
            weighted = J * weight
            gradient += weighted * residual
            normal += weighted @ J.T
        _, prior = self.point.prior()
        return gradient, normal, (prior.T @ prior)[:POSE, :POSE]

    @property
    def gradient(self) -> Array:
        """Gradient (POSE,) of half the cost."""
        value, jacobian = self.point.prior()
        total: Array = (
            self.options.data_weight * self._derivatives[0].sum(axis=1) + (jacobian.T @ value)[:POSE]
        )
        return total

    @property
    def normal(self) -> Array:
        """Gauss-Newton matrix (POSE, POSE) of half the cost."""
        _, data, prior = self._derivatives
        matrix: Array = self.options.data_weight * data + prior
        return matrix

    def moved(self, delta: Array) -> CalibratedFit:
        """Give the fit with its pose moved along the tangents (POSE,); the noise stays, the orders do not."""
        free = np.concatenate([delta, np.zeros(self.point.dimension - POSE)])
        return replace(self, point=self.point.step(free))

    def with_noise(self) -> CalibratedFit:
        """Estimate the noise anew from the residuals (one step of expectation-maximisation)."""
        weights = self.order_weights
        total = max(float(weights.sum()), TINY)
        scale = self.noise.scale * float(np.sqrt((weights * self.both**2).sum() / total))
        odds = (len(self.inliers) - total) / total
        noise = Noise(scale=float(np.clip(scale, *SCALES)), outlier_odds=float(np.clip(odds, *ODDS)))
        return replace(self, noise=noise)

    def curvature(self) -> Array:
        """Second derivative (POSE, POSE) of half the cost, by differences: unlike Gauss-Newton's it knows
        that a smear whose order or kind is in doubt says less.
        """  # noqa: D205
        spans = CURVATURE_STEP / np.sqrt(np.diag(self.normal))
        rows = [
            (self._frozen(span * e).gradient - self._frozen(-span * e).gradient) / (2 * span)
            for span, e in zip(spans, np.eye(POSE), strict=True)
        ]
        matrix = np.array(rows)
        matrix = 0.5 * (matrix + matrix.T)
        least = np.linalg.eigvalsh(matrix)[0]
        return matrix if least > 0 else self.normal

    def _frozen(self, delta: Array) -> CalibratedFit:
        return self.moved(delta)

    def oriented(self) -> OrientedPose:
        """Pose and order of every match, by positive depth."""
        plain = self.matches.residuals(self.point.matrix())
        return oriented_pose(self.point.matrix(), self.problem.ends, plain.forward_share, self.inliers)

    def covariance(self) -> PoseCovariance:
        """Covariance of the pose: the sandwich of an M-estimator."""
        gradient, _, prior = self._derivatives
        scatter = self.options.data_weight * MISSED * gradient @ gradient.T + prior
        return pose_covariance(self.curvature(), scatter, self.sign * plane_basis(self.point.t))


def settle(fit: CalibratedFit, steps: int) -> CalibratedFit:
    """Alternate a damped Gauss-Newton step of the pose and a step of the noise until both rest."""
    damping = 1e-3
    for _ in range(steps):
        normal, gradient = fit.normal, fit.gradient
        while damping < 1e6:
            damped = normal + damping * np.diag(np.diag(normal))
            delta = np.asarray(np.linalg.solve(damped, -gradient), float)
            trial = fit.moved(delta)
            if fit.cost_at(trial.point) <= fit.cost_at(fit.point):
                break
            damping *= 10
        else:
            break
        damping = max(damping / 10, 1e-9)
        fit = trial.with_noise()
        if float(np.sqrt(max(delta @ normal @ delta, 0.0))) < AT_REST:
            break
    return fit


def fit_calibrated(
    problem: SmearProblem, camera: CameraF, simple: TranslationF, options: RefineOptions
) -> CalibratedFit:
    """Fit the pose from the camera that was found and from no rotation.

    Parameters
    ----------
    problem : SmearProblem
        Smears in coordinates of the camera (K = identity), its intrinsics known.
    camera, simple : CameraF, TranslationF
        Fits to start from.
    options : RefineOptions
        ``cutoff`` and ``data_weight``.
    """
    spread = problem.prior
    poses = [(camera.R, camera.t), (np.eye(3), simple.epipole)]
    part = problem.subset(slice(None, None, max(1, len(problem.ends) // ROUGH_COUNT)))
    starts = [
        CalibratedFit(
            problem=part, point=CameraF(t=t, R=R, spread=spread), sign=sign, noise=Noise(), options=options
        )
        for R, t in poses
        for sign in (1.0, -1.0)
    ]
    starts = sorted(starts, key=lambda fit: fit.cost)[:STARTS]
    best = min((settle(start, ROUGH_STEPS) for start in starts), key=lambda fit: fit.cost)
    return settle(replace(best, problem=problem), STEPS)
