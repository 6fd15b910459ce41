"""Synthetic smears with exact truth: 640x480, an ordinary camera.

`synthetic_smears` are of a moving camera before two kinds of depth: "smooth", a tilted background with relief
and nearer cards, so that neighbouring smears have the same order; "scattered", every smear's depth is drawn
by itself, so that neighbours say nothing of each other's order. `draw_scene` is of six kinds of scenes, three
of which have no F.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import cv2
import numpy as np

from blur2view.arrays import Array, Mask
from blur2view.geometry.epipolar import fundamental_from_pose, homogeneous
from blur2view.geometry.pose import rotation_matrix
from blur2view.smears.grid import smear_ends
from blur2view.smears.matches import SmearMatches

IMAGE_SIZE = (640, 480)
FAR, NEAR = (3.0, 6.0), (1.0, 3.0)  # depths of the background and of cards; the unit is arbitrary
RELIEF = 0.1  # standard deviation of the log depth of near-planar scenes about their plane
NOISE_SPREAD = 0.7  # standard deviation of the log of the smears' own noise, where it varies
TURNING = (0.2, 1.0)  # median length of the rotation's smears over that of the translation's

Kind = Literal["smooth", "scattered"]
Motion = Literal["mixed", "forward", "sideways", "rotating", "near-planar"]
Report = Literal["equal", "constant", "varied", "varied, constant", "varied, wrong"]
Scene = Literal["no motion", "pure rotation", "plane", "pure translation", "general", "no geometry"]
SCENES: tuple[Scene, ...] = get_args(Scene)
NOISE_PX, OUTLIERS, LENGTH_PX, COUNT = (0.25, 1.0), (0.0, 0.3), (8.0, 40.0), (1000, 2000)
"""Of `draw_scene`: noise of every coordinate, share of random smears, median length, number of smears."""
SHARED_PX = 40.0  # standard deviation of the Gaussian over which a network's errors agree
CORRELATIONS_PX = (0.0, 20.0, 40.0, 80.0, 120.0)  # of the directions of fields without any geometry


@dataclass(frozen=True, kw_only=True)
class SyntheticOptions:
    """Properties of a set of synthetic smears.

    ``kind`` is how depth varies, ``length_px`` the median true length, ``noise_px`` the standard deviation of
    every coordinate of both ends (root mean square where it varies). A share of ``outliers`` has a random
    direction and 0.3 to 2 medians of length; the share ``second_motion``, nearest to a random point, has
    another rigid motion.

    ``motion``: "mixed", any direction and axis, the rotation's smears 0.2 to 1 times as long as the
    translation's; "forward", within about 10 degrees of the optical axis, 0 to 0.5 times; "sideways", across
    it; "rotating", any direction, 3 times; "near-planar", one tilted plane with relief of RELIEF.

    ``report`` is how noise varies and what ``sigma_px`` states of it: "equal", the same for all, the truth;
    "constant", the same, 1 px a coordinate; "varied", log-normal (NOISE_SPREAD), the truth; "varied,
    constant", its root mean square; "varied, wrong", that of other smears.
    """

    kind: Kind = "smooth"
    motion: Motion = "mixed"
    count: int = 1000
    length_px: float = 20.0
    noise_px: float = 1.0
    report: Report = "equal"
    outliers: float = 0.3
    second_motion: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownMatches:
    """Matches, whose ends are in random order, and their truth; pixels.

    ``R``, ``t`` are ``cam2_from_cam1``. ``true_ends`` (M, 2, 2) are exact smears of the camera's motion, open
    then close: of synthetic matches their own, where they are outliers, too. ``swapped`` (N,) marks matches
    whose ends[:, 1] is the open end.
    """

    K: Array
    R: Array
    t: Array
    matches: SmearMatches
    true_ends: Array
    swapped: Mask

    @property
    def F(self) -> Array:
        """The true F, of unit norm."""
        return fundamental_from_pose(self.K, self.R, self.t)

    @property
    def ordered(self) -> Array:
        """The ends (N, 2, 2) of the matches, open then close."""
        return with_swaps(self.matches.ends, self.swapped)


def with_swaps(ends: Array, swapped: Mask) -> Array:
    """Return smears (N, 2, 2), some of them with their ends exchanged."""
    return np.where(swapped[:, None, None], ends[:, ::-1], ends)


def synthetic_smears(seed: int, options: SyntheticOptions | None = None) -> KnownMatches:
    """Return smears of a random camera, scene and motion; the same seed and options give the same smears.

    Camera, scene and motion depend on the seed, kind, motion and length alone: sets that differ in noise or
    outliers show the same scenes.
    """
    options = options or SyntheticOptions()
    scene, noise, wrong = np.random.default_rng(seed).spawn(3)
    K, points = camera(scene), scene.uniform(0, 1, (options.count, 2)) * np.array(IMAGE_SIZE)
    depth = depths(scene, points, options)
    R, t = motion(scene, K, points, depth, options)
    true_ends = project_smears(K, R, t, points, depth)
    ends = true_ends.copy()
    apart = np.linalg.norm(points - points[wrong.integers(len(points))], axis=1)
    moving = np.argsort(apart, kind="stable")[: round(options.second_motion * len(points))]
    ends[moving] = project_smears(K, *motion(wrong, K, points, depth, options), points, depth)[moving]
    random = wrong.random(options.count) < options.outliers
    ends[random] = random_smears(wrong, true_ends)[random]
    own_px, sigma_px = noise_levels(noise, options)
    ends += own_px[:, None, None] * noise.normal(size=ends.shape)
    swapped = noise.random(options.count) < 0.5
    matches = SmearMatches(ends=with_swaps(ends, swapped), sigma_px=sigma_px, image_size=IMAGE_SIZE)
    return KnownMatches(K=K, R=R, t=t, matches=matches, true_ends=true_ends, swapped=swapped)


def draw_scene(kind: Scene, seed: int) -> KnownMatches:
    """Return a random scene; the same kind and seed give the same smears.

    "no motion": a still camera, so that smears are noise. "plane": one plane, tilted by about 20 degrees,
    any motion. "no geometry": smears of one length whose directions are random, correlated over 0 to 120 px.
    """
    rng = np.random.default_rng([seed, SCENES.index(kind)])
    count, length_px = int(rng.integers(*COUNT)), float(np.exp(rng.uniform(*np.log(LENGTH_PX))))
    K, points = camera(rng), rng.uniform(0, 1, (count, 2)) * np.array(IMAGE_SIZE)
    depth = tilted_plane(rng, points) if kind == "plane" else layered_depth(rng, points)
    share = {"pure rotation": np.inf, "pure translation": 0.0}.get(kind, rng.uniform(*TURNING))
    R, t = scaled_motion(K, points, depth, rng.normal(size=3), rng.normal(size=3), share, length_px)
    true_ends = project_smears(K, R, t, points, depth)
    if kind == "no geometry":
        true_ends = random_field(rng, points, length_px, float(rng.choice(CORRELATIONS_PX)))
    elif kind == "no motion":  # outliers are as long as if all had moved
        true_ends = np.stack([points, points + [length_px, 0.0]], axis=1)
    wrong = random_smears(rng, true_ends)
    if kind == "no motion":
        true_ends = np.stack([points, points], axis=1)
    random = rng.random(count) < rng.uniform(*OUTLIERS)
    noise_px = rng.uniform(*NOISE_PX)
    ends = np.where(random[:, None, None], wrong, true_ends) + noise_px * rng.normal(size=true_ends.shape)
    swapped, sigma_px = rng.random(count) < 0.5, np.full(count, 2 * noise_px)
    matches = SmearMatches(ends=with_swaps(ends, swapped), sigma_px=sigma_px, image_size=IMAGE_SIZE)
    return KnownMatches(K=K, R=R, t=t, matches=matches, true_ends=true_ends, swapped=swapped)


def camera(rng: np.random.Generator) -> Array:
    """Return K of a 640x480 camera: focal 0.8 to 1.5 widths, principal point about 1 % off the centre."""
    focal = IMAGE_SIZE[0] * rng.uniform(0.8, 1.5)
    centre = (np.array(IMAGE_SIZE) - 1) / 2 + rng.normal(0, 0.01, 2) * np.array(IMAGE_SIZE)
    return np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1.0]])


def depths(rng: np.random.Generator, points: Array, options: SyntheticOptions) -> Array:
    """Return the depth (N,) of pixels (N, 2) by the kind of the scene and, near-planar, the motion."""
    if options.motion == "near-planar":
        x, y = (points / np.array(IMAGE_SIZE) - 0.5).T
        plane = rng.uniform(*FAR) / np.maximum(1 + rng.normal(0, 0.3) * x + rng.normal(0, 0.4) * y, 0.3)
        waves = 2 * np.sin(9 * x + rng.uniform(0, 6)) * np.cos(7 * y + rng.uniform(0, 6))
        relief = waves if options.kind == "smooth" else rng.normal(size=len(points))
        return np.asarray(plane * np.exp(RELIEF * relief), float)
    if options.kind == "scattered":
        return np.asarray(np.exp(rng.uniform(np.log(NEAR[0]), np.log(FAR[1]), len(points))), float)
    return layered_depth(rng, points)


def layered_depth(rng: np.random.Generator, points: Array) -> Array:
    """Return the depth (N,) of pixels: a tilted background with relief, two to five cards in front."""
    x, y = (points / np.array(IMAGE_SIZE) - 0.5).T
    depth = rng.uniform(*FAR) * np.exp(rng.normal(0, 0.4) * x + rng.normal(0, 0.6) * y)
    depth = depth * np.exp(0.1 * np.sin(9 * x + rng.uniform(0, 6)) * np.cos(7 * y + rng.uniform(0, 6)))
    for _ in range(rng.integers(2, 6)):
        centre, half = rng.uniform(-0.5, 0.5, 2), rng.uniform(0.08, 0.25, 2)
        inside = (np.abs(x - centre[0]) < half[0]) & (np.abs(y - centre[1]) < half[1])
        depth[inside] = rng.uniform(*NEAR) * (1 + rng.normal(0, 0.3) * x[inside])
    return np.asarray(depth, float)


def tilted_plane(rng: np.random.Generator, points: Array) -> Array:
    """Return the depth (N,) of one plane at pixels (N, 2), at most 1 / 0.3 of its centre's."""
    slope = rng.normal(0, [0.3, 0.5])
    slope *= min(1.0, 0.7 / (0.5 * np.abs(slope).sum()))
    inverse = 1 + (points / np.array(IMAGE_SIZE) - 0.5) @ slope
    return np.asarray(rng.uniform(*FAR) / inverse)


def motion(
    rng: np.random.Generator, K: Array, points: Array, depth: Array, options: SyntheticOptions
) -> tuple[Array, Array]:
    """Return random R and t of which smears of the whole scene have the asked median length."""
    axis, heading = rng.normal(size=3), rng.normal(size=3)
    share = rng.uniform(*TURNING)
    if options.motion == "forward":
        heading, share = np.array([0.12, 0.12, 1.0]) * [*heading[:2], 1.0], rng.uniform(0, 0.5)
    elif options.motion == "sideways":
        heading = heading * [1.0, 1.0, 0.1]
    elif options.motion == "rotating":
        share = 3.0
    return scaled_motion(K, points, depth, axis, heading, share, options.length_px)


def scaled_motion(
    K: Array, points: Array, depth: Array, axis: Array, heading: Array, share: float, length_px: float
) -> tuple[Array, Array]:
    """Return R (3, 3) and t (3,): a rotation vector and a translation (3,) scaled to a median smear length.

    ``share`` is the median length of the smears of the rotation alone over that of the translation alone;
    0: pure translation, inf: pure rotation.
    """

    def length(turn: Array, move: Array) -> float:
        return median_length(project_smears(K, rotation_matrix(turn), move, points, depth))

    small, none = 1e-3, np.zeros(3)
    turn, move = small * axis / length(small * axis, none), small * heading / length(none, small * heading)
    turning, moving = (1.0, 0.0) if np.isinf(share) else (share, 1.0)
    factor = 1.0
    for _ in range(4):  # scale both together to the asked median length
        turn, move = turn * factor, move * factor
        factor = length_px / length(turning * turn, moving * move)
    return rotation_matrix(turning * turn), moving * move


def project_smears(K: Array, R: Array, t: Array, points: Array, depth: Array) -> Array:
    """Return the ends (N, 2, 2), open then close, of pixels at the given depths in the open camera."""
    rays = homogeneous(points) @ np.linalg.inv(K).T * depth[:, None]
    close = (rays @ R.T + t) @ K.T
    return np.stack([points, close[:, :2] / close[:, 2:]], axis=1)


def median_length(ends: Array) -> float:
    """Return the median smear length in pixels."""
    return float(np.median(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)))


def random_smears(rng: np.random.Generator, ends: Array) -> Array:
    """Return smears (N, 2, 2) at the same midpoints of random direction, 0.3 to 2 medians long."""
    angle = rng.uniform(0, 2 * np.pi, len(ends))
    length = rng.uniform(0.3, 2.0, len(ends)) * median_length(ends)
    vector = length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return smear_ends(ends.mean(axis=1), vector)


def noise_levels(rng: np.random.Generator, options: SyntheticOptions) -> tuple[Array, Array]:
    """Return the noise (N,) of every coordinate and the ``sigma_px`` (N,) that is reported of it."""
    own = np.ones(options.count)
    if options.report.startswith("varied"):
        own = np.exp(NOISE_SPREAD * rng.normal(size=options.count))
        own /= np.sqrt((own**2).mean())
    own = own * options.noise_px
    stated = {
        "constant": np.ones(options.count),
        "varied, constant": np.full(options.count, options.noise_px),
        "varied, wrong": rng.permutation(own),
    }.get(options.report, own)
    return own, 2 * np.maximum(stated, 1e-3)


def random_field(rng: np.random.Generator, points: Array, length_px: float, correlation_px: float) -> Array:
    """Return smears (N, 2, 2) about pixels, all of one length, of directions without geometry."""
    vector = np.stack([smooth_noise(rng, points, correlation_px) for _ in range(2)], axis=-1)
    return smear_ends(points, length_px * vector / np.linalg.norm(vector, axis=1, keepdims=True))


def smooth_noise(rng: np.random.Generator, points: Array, correlation_px: float) -> Array:
    """Return unit-variance noise (N,) at pixels, Gaussian-correlated over ``correlation_px`` (0: white)."""
    if correlation_px <= 0:
        return rng.normal(size=len(points))
    width, height = IMAGE_SIZE
    white = rng.normal(size=(height // 4 + 1, width // 4 + 1))
    field = cv2.GaussianBlur(white, (0, 0), correlation_px / 4)
    columns, rows = np.clip(np.rint(points / 4).astype(int), 0, [width // 4, height // 4]).T
    return np.asarray((field / field.std())[rows, columns], float)


def with_shared_errors(
    ends: Array, rng: np.random.Generator, direction_deg: float, length_share: float
) -> Array:
    """Return smears (N, 2, 2) that err as a network's: turned and stretched as their neighbours are.

    ``direction_deg`` and ``length_share`` are the standard deviations of the direction and of the length's
    natural logarithm; errors are correlated over SHARED_PX.
    """
    middle = ends.mean(axis=1)
    angle = np.radians(direction_deg) * smooth_noise(rng, middle, SHARED_PX)
    stretch = np.exp(length_share * smooth_noise(rng, middle, SHARED_PX))
    x, y = (ends[:, 1] - ends[:, 0]).T * stretch
    turned = np.stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y], axis=1)
    return smear_ends(middle, turned)
