"""The pose of a camera whose intrinsics are known: a consistent fit of E, and its covariance.

`refine` returns the cheapest point it meets. Here the noise is estimated with the pose, by expectation-
maximisation: the scale of the standard deviations, the share of outliers, the order of every smear; and what
is returned is the point at rest, whose errors then have the covariance of an M-estimator.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.geometry.pose import OrientedPose, PoseCovariance, oriented_pose, pose_covariance
from blur2view.geometry.rotation import plane_basis, rotation_matrix, rotation_vector
from blur2view.geometry.sampson import sampson_jacobian
from blur2view.robust.parametrization import CameraF, TranslationF
from blur2view.robust.problem import SmearProblem, coherent_residuals
from blur2view.robust.residuals import OrderedResiduals, RefineOptions, WeightedEnds
from blur2view.two_view.calibrated_start import ROUGH_COUNT, translation_search, turning_prior

POSE = 5  # of a camera's parameters, the first: two of t, three of R
STEPS, ROUGH_STEPS = 16, 6  # of expectation-maximisation, each with one Levenberg-Marquardt step
STARTS = 2  # poses tried on them beside that of the search
AT_REST = 1e-3  # a step below this many standard deviations ends it
SCALES, ODDS = (0.03, 4.0), (0.01, 3.0)  # limits of the noise's scale, and of the odds of an outlier
CURVATURE_STEP = 0.3  # standard deviations over which the gradient is differenced
MISSED = 1.1  # the regions of white noise hold what they should with variances larger by this
REACH, BINS = 0.3, 12  # of the autocorrelation: distances up to this share of the picture's size
PAIRS_OF = 500  # smears at most that are paired for it


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
        """Second derivative (POSE, POSE) of half the cost, by differences.

        Unlike Gauss-Newton's matrix it knows that a smear whose order or kind is in doubt says less.
        """
        spans = CURVATURE_STEP / np.sqrt(np.diag(self.normal) + TINY)
        rows = [
            (self.moved(span * e).gradient - self.moved(-span * e).gradient) / (2 * span)
            for span, e in zip(spans, np.eye(POSE), strict=True)
        ]
        matrix = np.array(rows)
        matrix = 0.5 * (matrix + matrix.T)
        least = np.linalg.eigvalsh(matrix)[0]
        return matrix if least > 0 else self.normal

    def oriented(self) -> OrientedPose:
        """Pose and order of every match, by positive depth."""
        plain = self.matches.residuals(self.point.matrix())
        return oriented_pose(self.point.matrix(), self.problem.ends, plain.forward_share, self.inliers)

    @cached_property
    def alike(self) -> float:
        """Number of smears that err as one: theirs is the variance of so many times fewer independent ones.

        From the autocorrelation of the residuals: its value near zero, and the distance at which it halves,
        as of a Gaussian. The problem's count suffices where half of the smears are independent.
        """
        counted = 1 / self.options.data_weight
        if counted < 2:
            return counted
        near, half = autocorrelation(self)
        middle = self.problem.ends.mean(axis=1)
        area = float(np.prod(np.ptp(middle, axis=0)))
        cluster = near * len(middle) * 2 * np.pi * (half**2 / (2 * np.log(2))) / max(area, TINY)
        independent = len(middle) / max(cluster, counted)
        return float(len(middle) / max(independent - POSE, 1.0))  # what the pose has taken up cannot be seen

    def covariance(self) -> PoseCovariance:
        """Covariance of the pose: the sandwich of an M-estimator, for errors that neighbours share."""
        gradient, _, prior = self._derivatives
        sign = np.copysign(1.0, self.oriented().pose.translation @ self.point.t)
        scatter = self.options.data_weight**2 * MISSED * self.alike * gradient @ gradient.T + prior
        return pose_covariance(self.curvature(), scatter, sign * plane_basis(self.point.t))


def autocorrelation(fit: CalibratedFit) -> tuple[float, float]:
    """Autocorrelation of the inliers' residuals near distance zero, and the distance at which it halves."""
    sure = np.flatnonzero(fit.inliers > 0.5)
    sure = sure[:: max(1, len(sure) // PAIRS_OF)]
    value = coherent_residuals(fit.problem, fit.point.matrix())[sure] / fit.noise.scale
    value, middle = np.clip(value, -3, 3), fit.problem.ends.mean(axis=1)[sure]
    one, other = np.triu_indices(len(sure), 1)
    distance = np.linalg.norm(middle[one] - middle[other], axis=1)
    width = REACH * float(np.sqrt(np.prod(np.ptp(middle, axis=0)))) / BINS
    bins = np.minimum((distance / max(width, TINY)).astype(int), BINS)
    pairs = np.maximum(np.bincount(bins, minlength=BINS + 1), 1)
    products = np.bincount(bins, weights=value[one] * value[other], minlength=BINS + 1)
    curve = (products / pairs)[:BINS] / max(float((value**2).mean()), TINY)
    below = np.flatnonzero(curve < 0.5 * curve[0])
    return float(np.clip(curve[0], 0, 1)), float((below[0] if len(below) else BINS) + 0.5) * width


def settle(fit: CalibratedFit, steps: int) -> CalibratedFit:
    """Alternate a damped Gauss-Newton step of the pose and a step of the noise until both rest."""
    damping = 1e-3
    for _ in range(steps):
        normal, gradient = fit.normal, fit.gradient
        while damping < 1e6:
            damped = normal + damping * np.diag(np.diag(normal) + 1e-12)
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
    """Fit the pose from the camera that was found, from no rotation, and from a search over translations.

    Parameters
    ----------
    problem : SmearProblem
        Smears in coordinates of the camera (K = identity), its intrinsics known.
    camera, simple : CameraF, TranslationF
        Fits to start from.
    options : RefineOptions
        ``cutoff`` and ``data_weight``.
    """
    spread = turning_prior(problem)
    centre = np.array(spread.centre)
    R, t = camera.R, camera.t
    if rotation_vector(R) @ centre < 0:  # the other flip of time
        R, t = R.T, -R.T @ t
    turn, heading = translation_search(problem.ends)
    searched = rotation_matrix(turn if turn @ centre >= 0 else -turn), heading
    part = problem.subset(slice(None, None, max(1, len(problem.ends) // ROUGH_COUNT)))

    def start(R: Array, t: Array, sign: float) -> CalibratedFit:
        point = CameraF(t=t, R=R, spread=spread)
        return CalibratedFit(problem=part, point=point, sign=sign, noise=Noise(), options=options)

    def cheapest(*poses: tuple[Array, Array]) -> list[CalibratedFit]:
        return sorted((start(R, t, sign) for R, t in poses for sign in (1.0, -1.0)), key=lambda fit: fit.cost)

    found = cheapest((R, t), (rotation_matrix(centre), simple.epipole))[:STARTS]
    starts = [*found, cheapest(searched)[0]]  # its own cost is high before it settles: it is always tried
    best = min((settle(start, ROUGH_STEPS) for start in starts), key=lambda fit: fit.cost)
    return settle(replace(best, problem=problem), STEPS)
