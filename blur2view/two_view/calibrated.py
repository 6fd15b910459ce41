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
from blur2view.geometry.rotation import plane_basis, rotation_matrix
from blur2view.robust.independence import ALIKE, block_scatter, slow_errors
from blur2view.robust.levenberg_marquardt import levenberg_marquardt, normal_equations
from blur2view.robust.parametrization import CameraF, TranslationF
from blur2view.robust.problem import SmearProblem
from blur2view.robust.refinement import Linearised, WeightedPoint
from blur2view.robust.residuals import RefineOptions
from blur2view.two_view.calibrated_start import translation_search
from blur2view.two_view.rotation_only import ROUGH_COUNT

POSE = 5  # of a camera's parameters, the first: two of t, three of R
STEPS, ROUGH_STEPS = 16, 6  # of expectation-maximisation, each with one Levenberg-Marquardt step
STARTS = 2  # poses tried on them beside that of the search
AT_REST = 1e-3  # a step below this many standard deviations ends it
SCALES, ODDS = (0.03, 4.0), (0.01, 3.0)  # limits of the noise's scale, and of the odds of an outlier
CURVATURE_STEP = 0.3  # standard deviations over which the gradient is differenced
MISSED = 1.1  # the regions of white noise hold what they should with variances larger by this
SLOW_STEP = 0.05  # of slow errors, by which the gradient is differenced


@dataclass(frozen=True, kw_only=True)
class Noise:
    """The scale of the standard deviations, and the odds of being an outlier."""

    scale: float = 1.0
    outlier_odds: float = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedFit:
    """A pose among its smears (`levenberg_marquardt.Reweighted`), with the noise estimated beside it.

    ``state`` is the camera (its lens fixed) with the residuals and the odds of the orders under ``noise``.
    """

    problem: SmearProblem
    noise: Noise
    state: WeightedPoint[CameraF]

    @classmethod
    def at(
        cls, problem: SmearProblem, point: CameraF, sign: float, noise: Noise, options: RefineOptions
    ) -> CalibratedFit:
        """Return the smears of a problem weighed at a camera, the sign of its translation and a noise.

        An outlier's Sampson distance has the density 2^0.5 / (pi length) at zero: its direction is random.
        """
        stated = problem.weighted
        sigma = stated.sigma * noise.scale
        length = np.maximum(problem.length_px / problem.unit_px, TINY)
        chance = noise.outlier_odds * np.minimum(2 / np.pi**0.5 * sigma / length, 1.0)
        matches = replace(stated, sigma=sigma, chance=chance)
        plain = matches.residuals(point.matrix())
        state = WeightedPoint(point=point, matches=matches, residuals=plain, sign=sign, options=options)
        return cls(problem=problem, noise=noise, state=state.reweighted())

    @property
    def point(self) -> CameraF:
        """The camera."""
        return self.state.point

    @property
    def options(self) -> RefineOptions:
        """How it is refined."""
        return self.state.options

    @property
    def inliers(self) -> Array:
        """Probabilities (N,) of being an inlier."""
        return self.state.inliers

    @cached_property
    def cost(self) -> float:
        """Twice the negative log-posterior, of the noise too."""
        noise = 2 * np.log(self.noise.scale * (1 + self.noise.outlier_odds)) * len(self.inliers)
        chance = -2 * np.log1p(np.asarray(self.state.matches.chance)).sum()  # costs are 0 for perfect inliers
        return self.state.cost + self.options.data_weight * float(noise + chance)

    @cached_property
    def linearised(self) -> Linearised:
        """Both orders of every smear, those of no weight too: what is sought is the point at rest."""
        return self.state.linearised(negligible=0.0)

    def normal_equations(self) -> tuple[Array, Array]:
        """Return Gauss-Newton's matrix (POSE, POSE) and the gradient (POSE,) of half the cost."""
        data, (value, jacobian) = self.linearised, self.point.prior()
        weight = self.options.data_weight * data.weight
        return normal_equations(data.jacobian[:POSE], data.residual, weight, value, jacobian[:, :POSE])

    def moved(self, delta: Array) -> CalibratedFit:
        """Return the fit with its pose moved along the tangents (POSE,), weights and noise as they are."""
        free = np.concatenate([delta, np.zeros(self.point.dimension - POSE)])
        return replace(self, state=self.state.moved(free))

    def reordered(self) -> CalibratedFit:
        """Return the fit with the orders weighed anew."""
        return replace(self, state=self.state.reweighted())

    def reweighted(self) -> CalibratedFit:
        """Return the fit with orders weighed anew, then the noise (a step of expectation-maximisation)."""
        state = self.state.reweighted()
        weights, residuals = state.order_weights, state.residuals
        total = max(float(weights.sum()), TINY)
        scale = self.noise.scale * float(np.sqrt((weights * residuals.both**2).sum() / total))
        odds = (len(self.inliers) - total) / total
        noise = Noise(scale=float(np.clip(scale, *SCALES)), outlier_odds=float(np.clip(odds, *ODDS)))
        return CalibratedFit.at(self.problem, state.point, state.sign, noise, self.options)

    def curvature(self) -> Array:
        """Return the second derivative (POSE, POSE) of half the cost, by differences.

        Unlike Gauss-Newton's matrix it knows that a smear whose order or kind is in doubt weighs less.
        """
        normal, _ = self.normal_equations()
        spans = CURVATURE_STEP / np.sqrt(np.diag(normal) + TINY)
        rows = []
        for span, e in zip(spans, np.eye(POSE), strict=True):
            ahead, behind = (self.moved(s * e).reordered().normal_equations()[1] for s in (span, -span))
            rows.append((ahead - behind) / (2 * span))
        matrix = np.array(rows)
        matrix = 0.5 * (matrix + matrix.T)
        least = np.linalg.eigvalsh(matrix)[0]
        return matrix if least > 0 else normal

    def oriented(self) -> OrientedPose:
        """Return the pose and the order of every match, by positive depth."""
        F = self.point.matrix()
        plain = self.state.matches.residuals(F)
        return oriented_pose(F, self.problem.ends, plain.forward_share, self.inliers)

    def slow_gradients(self) -> Array:
        """Return the change (POSE, 6) of the gradient by each of `slow_errors`."""
        columns = []
        for error in SLOW_STEP * slow_errors(self.problem):
            half = np.stack([-0.5 * error, 0.5 * error], axis=1)
            ahead, behind = (
                replace(
                    self, problem=replace(self.problem, ends=self.problem.ends + sign * half)
                ).gradient_there()
                for sign in (1.0, -1.0)
            )
            columns.append((ahead - behind) / (2 * SLOW_STEP))
        return np.stack(columns, axis=1)

    def gradient_there(self) -> Array:
        """Return the gradient (POSE,) of half the cost for the smears of ``problem``."""
        there = CalibratedFit.at(self.problem, self.point, self.state.sign, self.noise, self.options)
        return there.normal_equations()[1]

    def covariance(self) -> PoseCovariance:
        """Return the covariance of the pose: an M-estimator's sandwich, for errors that neighbours share."""
        data = self.linearised
        terms = self.options.data_weight * data.jacobian[:POSE] * data.weight * data.residual
        by_smear: Array = np.stack([np.bincount(data.smear, row, len(self.inliers)) for row in terms])
        prior = self.point.prior()[1][:, :POSE]
        sign = np.copysign(1.0, self.oriented().pose.translation @ self.point.t)
        scatter = prior.T @ prior
        if self.options.data_weight < ALIKE:
            slow = self.slow_gradients()
            scatter += block_scatter(by_smear, self.problem.ends.mean(axis=1)) + slow @ slow.T
        else:
            scatter += MISSED / self.options.data_weight * by_smear @ by_smear.T
        return pose_covariance(self.curvature(), scatter, sign * plane_basis(self.point.t))


def converged(fit: CalibratedFit, steps: int) -> CalibratedFit:
    """Return the fit after steps of the pose, each followed by one of the noise, once both rest."""
    for step in levenberg_marquardt(fit, steps):
        fit = step.point
        if step.sigmas < AT_REST:
            break
    return fit


def fit_calibrated(
    problem: SmearProblem, camera: CameraF, simple: TranslationF, options: RefineOptions
) -> CalibratedFit:
    """Return the pose fitted from a camera's fit, from no rotation, and from a search over translations.

    Parameters
    ----------
    problem : SmearProblem
        Smears in coordinates of the camera (K = identity), its intrinsics known.
    camera, simple : CameraF, TranslationF
        Fits to start from.
    options : RefineOptions
        ``cutoff`` and ``data_weight``.
    """
    rotation, heading = translation_search(problem.ends)
    part = problem.subset(slice(None, None, max(1, len(problem.ends) // ROUGH_COUNT)))

    def start(R: Array, t: Array, sign: float) -> CalibratedFit:
        point = CameraF(t=t, R=R, spread=problem.prior)
        return CalibratedFit.at(part, point, sign, Noise(), options)

    def cheapest(*poses: tuple[Array, Array]) -> list[CalibratedFit]:
        return sorted((start(R, t, sign) for R, t in poses for sign in (1.0, -1.0)), key=lambda fit: fit.cost)

    near = cheapest((camera.R, camera.t), (np.eye(3), simple.epipole))[:STARTS]
    far = cheapest((rotation_matrix(rotation), heading))[0]  # always tried: its own cost is high at first
    starts = [*near, far]
    best = min((converged(start, ROUGH_STEPS) for start in starts), key=lambda fit: fit.cost)
    return converged(CalibratedFit.at(problem, best.point, best.state.sign, best.noise, options), STEPS)
