"""The smears of one image as a problem for the robust loop: coordinates, standard deviations, scores."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.cameras import Camera
from blur2view.components import SignComponents, sample_patterns
from blur2view.epipolar import (
    TINY,
    Array,
    cross_matrix,
    denormalise,
    homogeneous,
)
from blur2view.hypotheses import half_sphere, meeting_points, turning_hypotheses, weighted_samples
from blur2view.manifold import CameraPrior, GeneralF, TranslationF
from blur2view.refine import RefineOptions, WeightedEnds, refine
from blur2view.scoring import BatchSampson
from blur2view.seven_smears import SAMPLE_SIZE, solve_seven_smears

ASSUMED_FOCAL = 1.2  # focal length over the longer side of the image: a 45 degree lens
TURN_SPREAD = np.array(
    [1.0, 1.0, 3.0]
)  # prior of the rotation: smear length over focal length; roll moves less
OUTLIER_ODDS = 0.5  # of a smear; an outlier's residual is uniform between -+ its length / sqrt(2)
LENGTH_ERROR = 0.1  # standard deviation of a smear's length, over the length, beyond sigma_px
BLOCKS = 5  # blocks along the longer side in which residuals are compared
COMPANY = 6  # smears in a component of this size are sampled fully, single ones a sixth as often
WIDE, SEARCH_STEPS = 3.0, 4  # Levenberg-Marquardt steps inside the loop; the final fit takes more
DOUBT = 2  # every second sample takes all sign patterns: else a wrong grouping costs 30 % in rho


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearProblem:
    """Smears in shared normalised coordinates with the standard deviation of their Sampson distance.

    Parameters
    ----------
    ends : ndarray of shape (N, 2, 2)
        Ends under ``T``.
    sigma_px : ndarray of shape (N,)
        Standard deviation of the Sampson distance in pixels.
    T : ndarray of shape (3, 3)
        Pixels to normalised coordinates: the inverse of the assumed camera when the image's size is known.
    camera_known : bool
        Whether T is that of an assumed camera.
    independent : float
        Effective number of independent smears: network errors are alike over tens of pixels.
    lens : (float, float)
        Standard deviations of the log focal length and of the principal point in focal lengths; (0, 0) if
        the intrinsics are known.
    scale : float
        What the standard deviations as given were multiplied by since.
    """

    ends: Array
    sigma_px: Array
    T: Array
    camera_known: bool
    independent: float
    lens: tuple[float, float] = (CameraPrior.log_focal, CameraPrior.principal)
    scale: float = 1.0
    components: SignComponents | None = None

    @property
    def unit_px(self) -> float:
        """Pixels per normalised unit."""
        return float((self.T[0, 0] * self.T[1, 1]) ** -0.5)

    @property
    def calibrated(self) -> bool:
        """Whether the intrinsics are known."""
        return self.lens == (0.0, 0.0)

    @property
    def data_weight(self) -> float:
        """Share of the smears that counts as independent."""
        return min(1.0, self.independent / len(self.ends))

    @cached_property
    def weighted(self) -> WeightedEnds:
        """The smears as `refine` wants them."""
        along_px = np.hypot(2**0.5 * self.sigma_px, LENGTH_ERROR * self.length_px)
        return WeightedEnds(
            ends=self.ends,
            sigma=self.sigma_px / self.unit_px,
            along=along_px / self.unit_px,
            components=self.components,
            chance=OUTLIER_ODDS * np.minimum(np.pi**0.5 * self.sigma_px / (self.length_px + TINY), 1),
        )

    @cached_property
    def length_px(self) -> Array:
        """Lengths (N,) in pixels."""
        length: Array = np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=-1) * self.unit_px
        return length

    @property
    def prior(self) -> CameraPrior:
        """What an ordinary camera does while smears of this length arise."""
        x, y, z = TURN_SPREAD * float(np.median(self.length_px)) / self.unit_px
        return CameraPrior(rotation=(x, y, z), log_focal=self.lens[0], principal=self.lens[1])

    def rescaled(self, factor: float) -> SmearProblem:
        """Give the problem with all standard deviations multiplied by a factor."""
        return replace(self, sigma_px=self.sigma_px * factor, scale=self.scale * factor)

    def subset(self, index: NDArray[np.int_] | slice) -> SmearProblem:
        """Give the problem of some smears; the share of independent ones stays."""
        ends = self.ends[index]
        independent = self.independent * len(ends) / len(self.ends)
        components = None if self.components is None else self.components.subset(index)
        return replace(
            self, ends=ends, sigma_px=self.sigma_px[index], independent=independent, components=components
        )

    def pixels(self, F: Array) -> Array:
        """F of pixel coordinates, unit norm, from F of normalised ones."""
        return denormalise(F, self.T)


def assumed_camera(image_size: tuple[float, float]) -> Array:
    """K^-1 (3, 3) of the assumed camera: principal point at the centre, focal 1.2 times the longer side."""
    width, height = image_size
    focal = ASSUMED_FOCAL * max(width, height)
    return np.array(
        [[1 / focal, 0, -(width - 1) / 2 / focal], [0, 1 / focal, -(height - 1) / 2 / focal], [0, 0, 1]]
    )


def assumed_camera_of(ends: Array) -> Array:
    """K^-1 (3, 3) of the camera assumed for an image that just holds the ends (N, 2, 2)."""
    points = ends.reshape(-1, 2)
    low, size = points.min(axis=0), np.maximum(np.ptp(points, axis=0), TINY)
    T = assumed_camera((size[0] + 1, size[1] + 1))
    T[:2, 2] -= T[0, 0] * low
    return T


def occupied_blocks(points: Array, block_px: float) -> int:
    """Count square blocks of this side that hold a point (N, 2)."""
    return len(np.unique(np.floor(points / block_px).astype(int), axis=0))


def build_problem(
    ends: Array, sigma_px: Array, image_size: tuple[int, int] | None, camera: Camera | None = None
) -> SmearProblem:
    """Normalise smears (N, 2, 2); sigma_px (N,) is that of the Sampson distance, pixels.

    Coordinates are those of the camera, for whose undistorted pixels the ends are given, else of an assumed
    one; without an image size none is assumed. Every smear counts as independent until `independent_count`.
    """
    if camera is not None:
        T: Array = np.asarray(np.linalg.inv(camera.K), float)
    else:
        T = assumed_camera(image_size) if image_size is not None else assumed_camera_of(ends)
    problem = SmearProblem(
        ends=ends * np.diag(T)[:2] + T[:2, 2],
        sigma_px=sigma_px,
        T=T,
        camera_known=camera is not None or image_size is not None,
        independent=float(len(ends)),
    )
    if camera is None:
        return problem
    return replace(problem, lens=(camera.log_focal_sigma, 0.0 if camera.known else CameraPrior.principal))


def coherent_residuals(problem: SmearProblem, F: Array) -> Array:
    """Residuals (N,) in standard deviations whose signs agree where neighbouring smears err alike.

    Every displacement is turned to run along its epipolar line, away from or towards the epipole; its
    residual across the line is then sign(l) (|l| - |q|).
    """
    both = problem.weighted.residuals(F)
    line = homogeneous(problem.ends.mean(axis=1)) @ F.T
    d = problem.ends[:, 1] - problem.ends[:, 0]
    along = d[:, 0] * line[:, 1] - d[:, 1] * line[:, 0]
    skew, symmetric = 0.5 * (both.forward - both.backward), 0.5 * (both.forward + both.backward)
    signed: Array = np.sign(along) * np.sign(skew) * (np.abs(skew) - np.abs(symmetric))
    return signed


def independent_count(problem: SmearProblem, F: Array, cutoff: float) -> float:
    """Effective number of independent smears, from how alike the residuals of F are within blocks.

    The sum of m residuals of variance v has variance m v if they are independent and m^2 v if they agree;
    the ratio of the two, summed over blocks (a fifth of the points' extent), is the number of smears that
    make one.
    """
    value = coherent_residuals(problem, F)
    value = np.where(np.abs(value) < cutoff, value, 0.0)
    middle = problem.ends.mean(axis=1)
    block = np.floor((middle - middle.min(axis=0)) / (np.ptp(middle, axis=0).max() / BLOCKS + TINY)).astype(
        int
    )
    _, index = np.unique(block, axis=0, return_inverse=True)
    sums = np.bincount(index.ravel(), weights=value)
    cluster = float(sums @ sums) / max(float(value @ value), TINY)
    return len(value) / max(cluster, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearEstimator:
    """F from seven smears, or from three and a grid of directions (`ransac.Estimator`).

    Models are F (3, 3) in normalised coordinates. The score is MSAC's: squared residuals in standard
    deviations, cut at ``cutoff``. ``fit_error_px`` is the paper's threshold on the root of SErrMin for the
    stop on fit.
    """

    problem: SmearProblem
    cutoff: float
    fit_error_px: float
    components: SignComponents
    directions: int = 150

    @property
    def sample_size(self) -> int:
        """Three: with a camera guessed from the points, if need be, three smears and a direction do."""
        return 3

    @property
    def count(self) -> int:
        """Number of smears."""
        return len(self.problem.ends)

    @cached_property
    def sampson(self) -> BatchSampson:
        """SErrMin of many models at once, squared pixels."""
        return BatchSampson(self.problem.ends, self.problem.unit_px)

    @cached_property
    def quality(self) -> Array:
        """Sampling weights (N,): length over standard deviation, squared; less where no neighbour agrees."""
        company = np.minimum(self.components.sizes, COMPANY)[self.components.label] / COMPANY
        weights: Array = company * (self.problem.length_px / self.problem.sigma_px) ** 2
        return weights

    @cached_property
    def precision(self) -> NDArray[np.float32]:
        """1 / sigma^2 (N,)."""
        return np.asarray(1 / self.problem.sigma_px**2, np.float32)

    def generate_models(self, samples: int, rng: np.random.Generator) -> Array:
        """Candidates (M, 3, 3) of ``samples`` samples of three and, where no camera is known, of seven."""
        ends, limit = self.problem.ends, 3 * np.array(self.problem.prior.rotation)
        directions, doubted = half_sphere(self.directions), np.arange(samples) % DOUBT == 0
        three = weighted_samples(self.quality, 3, samples, rng)
        models = [
            turning_hypotheses(ends[three[group.index]], directions, limit, group.signs)
            for group in sample_patterns(self.components, three, doubted)
        ]
        if not self.problem.camera_known:
            seven = weighted_samples(self.quality, SAMPLE_SIZE, samples, rng)
            for group in sample_patterns(self.components, seven, doubted):
                models.append(solve_seven_smears(ends[seven[group.index]], group.signs)[0])
        return np.concatenate(models)

    def residuals(self, models: Array, block: NDArray[np.int_] | slice = slice(None)) -> NDArray[Any]:
        """SErrMin in squared standard deviations, (M, n)."""
        squared: NDArray[Any] = self.sampson(models, block) * self.precision[block]
        return squared

    def score(self, models: Array, block: NDArray[np.int_]) -> NDArray[Any]:
        """MSAC cost (M,)."""
        total: NDArray[Any] = np.minimum(self.residuals(models, block), self.cutoff**2).sum(axis=1)
        return total

    def refine(self, model: Array) -> Array:
        """Few steps on the seven-parameter manifold, wider standard deviations first: models are coarse."""
        options = RefineOptions(max_iterations=SEARCH_STEPS, cutoff=self.cutoff, decided=True)
        point = GeneralF.from_matrix(model)
        for width in (WIDE, 1.0):
            matches = replace(self.problem.weighted, sigma=width * self.problem.weighted.sigma)
            point, _ = refine(point, matches, options)
        return point.matrix()

    def shares(self, model: Array) -> tuple[float, float]:
        """Share under the paper's threshold; share of inliers beyond those that fit by chance.

        A smear of length L turned at random passes a bound on its Sampson distance with probability
        2 / pi asin(sqrt(2) bound / L) in one order; two orders are two chances.
        """
        squared = self.sampson(model[None])[0]
        bound = 2**0.5 * self.cutoff * self.problem.sigma_px / np.maximum(self.problem.length_px, TINY)
        chance = 1 - (1 - 2 / np.pi * np.arcsin(np.minimum(bound, 1.0)).mean()) ** 2
        inside = float((squared * self.precision < self.cutoff**2).mean())
        return float((squared < self.fit_error_px**2).mean()), (inside - chance) / max(1 - chance, TINY)


def translation_start(estimator: SmearEstimator, samples: int, rng: np.random.Generator) -> TranslationF:
    """Best meeting point of pairs of smears: the start of the two-parameter F."""
    drawn = weighted_samples(estimator.quality, 2, samples, rng)
    points = meeting_points(estimator.problem.ends[drawn])
    points = points[np.linalg.norm(points, axis=1) > 0.5]
    if not len(points):
        return TranslationF(epipole=np.array([0.0, 0.0, 1.0]))
    order = rng.permutation(estimator.count)[:500]
    cost = estimator.score(cross_matrix(points), order)
    return TranslationF(epipole=points[int(np.argmin(cost))])
