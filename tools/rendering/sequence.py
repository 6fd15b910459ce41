"""Render a video of blurred frames: one scene, one long camera path, the exact pose at every instant.

    python -m tools.rendering.sequence render/sequence --frames 16 --photos KODAK

writes ``frame_000.png``, ... and ``truth.npz`` (K; cam_from_world at shutter-open, at mid exposure and at
shutter-close; true smears on the stride-4 grid). The scene is described in the frame of time 0, as every
scene of `scene`, and painted once, with a margin as wide as the camera goes; a frame is then one
exposure about its own instant. Same seed and options, same bytes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from blur2view.arrays import AnyArray as Array
from blur2view.errors import Blur2ViewError
from tools.arguments import existing, parser_of
from tools.datasets.testset import sharp_photograph
from tools.rendering.canvas import Canvas, paint
from tools.rendering.exposure import KNOTS, Exposure, grid_points
from tools.rendering.render import compose, mean_frame
from tools.rendering.scene import Layer, Plane, sample_card, sample_illumination, tilted_normal
from tools.rendering.textures import photographs
from tools.rendering.wandering import sample_path

LARGEST_TILT, GROUND = 0.3, 0.3
"""Tilt of the wall, radians; height above the ground: no more than the path allows without a look behind."""
STEPS = 60
"""Fixed-point steps at most."""
SOLVED_PX = 0.01


@dataclass(frozen=True, kw_only=True)
class Poster(Plane):
    """A plane whose texture is centred where the camera of time 0 looks, not mirrored there."""

    def texel(self, rays: Array) -> Array:
        """Return texture coordinates (..., 2), in texels, where rays (..., 3) meet the plane."""
        ahead = super().texel(
            np.array([0.0, 0.0, 1.0]) if self.normal[2] > 0.5 else np.array([0.0, 0.5, 1.0])
        )
        return np.asarray(super().texel(rays) - ahead + np.array(self.texture.shape[1::-1]) / 2)


@dataclass(frozen=True, kw_only=True)
class SequenceOptions:
    """What a video is.

    Parameters
    ----------
    frames : int
        How many.
    size : (int, int)
        Width and height, multiples of 4.
    smear_px : float
        Median length of the background's smears over all frames.
    exposure_share : float
        How long the shutter is open, of the time from frame to frame.
    cards : int
        Objects before the background.
    rotation_share : float
        Size of the rotation vectors over that of the translations at unit depth. A hand's is larger still
        (RedKitchen: 3.6 by their flow), but then COLMAP's angles need hundreds of frames.
    photos : Path or None
        Folder of further photographs used as textures.
    detail : float
        Canvas pixels per image pixel.
    """

    frames: int = 14
    size: tuple[int, int] = (640, 480)
    smear_px: float = 14.0
    exposure_share: float = 0.6
    cards: int = 6
    rotation_share: float = 1.0
    photos: Path | None = None
    detail: float = 1.25


@dataclass(frozen=True, kw_only=True, eq=False)
class SequenceTruth:
    """What happened in a video of N frames.

    Parameters
    ----------
    K : ndarray of shape (3, 3)
        Intrinsics, our pixels.
    poses : ndarray of shape (N, 3, 3, 4)
        cam_from_world [R | t] at shutter-open, at mid exposure, at shutter-close.
    displacement : ndarray of shape (N, H/4, W/4, 2)
        float32, close - open, pixels, of what is seen at the grid's points at mid exposure.
    """

    K: Array
    poses: Array
    displacement: Array

    @property
    def smear_px(self) -> Array:
        """Return the median smear length of every frame, (N,)."""
        return np.asarray(np.median(np.linalg.norm(self.displacement, axis=-1), axis=(1, 2)))

    @property
    def relative(self) -> Array:
        """Return cam_close_from_cam_open [R | t] of every frame, (N, 3, 4)."""
        return np.stack([relative_pose(first, last) for first, _, last in self.poses])


def relative_pose(first: Array, second: Array) -> Array:
    """Return cam2_from_cam1 [R | t] (3, 4) of two cam_from_world."""
    R = second[:, :3] @ first[:, :3].T
    return np.column_stack([R, second[:, 3] - R @ first[:, 3]])


def collage(rng: np.random.Generator, pool: tuple[Array, ...]) -> Array:
    """Return six photographs of the pool beside each other (1024, 1536, 3): nothing repeats, as in a room."""
    chosen = rng.permutation(max(len(pool), 6))[:6] % len(pool)
    tiles = [cv2.resize(pool[k], (512, 512), interpolation=cv2.INTER_AREA) for k in chosen]
    return np.vstack([np.hstack(tiles[:3]), np.hstack(tiles[3:])]).astype(np.float32)


def sample_scene(rng: np.random.Generator, options: SequenceOptions, K: Array) -> list[Layer]:
    """Return a random wall, ground and cards in front of them, far to near."""
    pool = photographs("test", options.photos)
    slope = np.array([rng.normal(0, 0.05), 1.0, rng.normal(0, 0.05)])
    places = ((tilted_normal(rng, LARGEST_TILT), 1.0), (slope / np.linalg.norm(slope), GROUND))
    planes = tuple(
        Poster(normal=n, offset=far, texture=collage(rng, pool), texels_per_unit=K[0, 0] / far, turn=0.0)
        for n, far in places
    )
    depths = np.sort(rng.uniform(0.5, 0.85, options.cards))[::-1]
    cards = [sample_card(rng, pool, K, options.size, float(depth)) for depth in depths]
    still = np.zeros((2, 2), np.float32)
    return [Layer(planes=planes, relief=still, illumination=sample_illumination(rng)), *cards]


def instants(options: SequenceOptions) -> Array:
    """Return the times (N,) of mid exposure, about 0."""
    return np.arange(options.frames) - (options.frames - 1) / 2


def origins(exposure: Exposure, layer: Layer, tau: float, start: Array) -> Array:
    """Return where (h, w, 2) at time 0 the points lay that are seen at the ringed grid's points at time tau.

    Fixed-point iteration from `start` (h, w, 2). It converges where a surface has one point for every ray.
    ValueError if the background, which is everywhere, has none for a hundredth of them: the path is too long.
    """
    target, x = grid_points(exposure.size, ring=1), start
    for _ in range(STEPS):
        step = exposure.moved(x, layer, tau) - target
        x = np.clip(x - step, -3 * max(exposure.size), 4 * max(exposure.size))
        if np.abs(step).max() < SOLVED_PX:
            break
    if layer.stencil is None and (np.abs(step).max(axis=-1) > 10 * SOLVED_PX).mean() > 0.01:
        raise ValueError(f"the camera goes too far at time {tau:.2f}: choose shorter smears or fewer frames")
    return x


@dataclass(frozen=True, kw_only=True, eq=False)
class Video:
    """A painted scene before a camera on its path.

    Parameters
    ----------
    exposure : Exposure
        Camera, path in frames, picture size.
    canvases : list of Canvas
        Far to near, painted as seen at time 0.
    share : float
        How long the shutter is open, in frames.
    """

    exposure: Exposure
    canvases: list[Canvas]
    share: float

    def fields(self, middle: float) -> list[Array]:
        """Return for every layer the fields (knots, h+2, w+2, 2) of the exposure about a time in frames."""
        return [inverse_displacements(self.exposure, c.layer, middle, self.share) for c in self.canvases]

    def displacement(self, middle: float, fields: list[Array]) -> Array:
        """Return close - open (h, w, 2), pixels, of what the grid's points show at mid exposure."""
        target, half = grid_points(self.exposure.size), self.share / 2
        found: Array = np.zeros(target.shape, np.float32)
        for canvas, knots in zip(self.canvases, fields, strict=True):
            origin = target + knots[len(KNOTS) // 2][1:-1, 1:-1]
            seen = canvas.warp(origin.astype(np.float32))[..., 3] > 0.5
            if seen.any():
                first, last = (
                    self.exposure.moved(origin[seen], canvas.layer, middle + at) for at in (-half, half)
                )
                found[seen] = last - first
        return found

    def poses(self, times: Array) -> Array:
        """Return cam_from_world (N, 3, 3, 4) at the ends and the middle of exposures about times (N,)."""
        return np.stack(
            [[self.pose(middle + self.share * at) for at in (-0.5, 0.0, 0.5)] for middle in times]
        )

    def pose(self, time: float) -> Array:
        """Return cam_from_world [R | t] (3, 4) at a time in frames."""
        R, centre = self.exposure.camera.at(time)
        return np.column_stack([R, -R @ centre])


def inverse_displacements(exposure: Exposure, layer: Layer, middle: float, share: float) -> Array:
    """Return fields (knots, h+2, w+2, 2) of one exposure, like :meth:`Exposure.inverse_displacements`."""
    target = grid_points(exposure.size, ring=1)
    fields, x = [], target
    for tau in middle + share * KNOTS:
        x = origins(exposure, layer, tau, x)
        fields.append(x - target)
    return np.stack(fields)


def scaled_to(exposure: Exposure, layers: list[Layer], options: SequenceOptions) -> Exposure:
    """Return the path scaled to the options' median smear of the background over all frames."""
    points, half = grid_points(exposure.size)[::4, ::4], options.exposure_share / 2
    wall, factor = layers[0], 0.01  # it fills most of the picture; what is before it moves faster
    for _ in range(6):
        at = replace(exposure, camera=exposure.camera.scaled(factor))
        lengths = [
            np.linalg.norm(at.moved(points, wall, t + half) - at.moved(points, wall, t - half), axis=-1)
            for t in instants(options)
        ]
        factor *= options.smear_px / float(np.median(lengths))
    return replace(exposure, camera=exposure.camera.scaled(factor))


def travel_px(exposure: Exposure, layers: list[Layer], options: SequenceOptions) -> float:
    """Return how far beyond the picture of time 0 any frame sees the background, pixels."""
    reach = [
        np.abs(inverse_displacements(exposure, layers[0], t, options.exposure_share)[[0, -1]]).max()
        for t in instants(options)[::3]
    ]
    return float(min(max(reach) * 1.2 + 8, max(exposure.size)))


def camera_of(size: tuple[int, int]) -> Array:
    """Return K (3, 3) of an ordinary camera, 56 degrees across."""
    return np.array(
        [[0.95 * size[0], 0, (size[0] - 1) / 2], [0, 0.95 * size[0], (size[1] - 1) / 2], [0, 0, 1]]
    )


def paint_video(seed: int, options: SequenceOptions) -> Video:
    """Return scene and path of a seed, the scene painted."""
    rng = np.random.default_rng([seed, 5])
    K = camera_of(options.size)
    layers = sample_scene(rng, options, K)
    path = sample_path(rng, options.rotation_share)
    exposure = scaled_to(Exposure(camera=path, K=K, size=options.size), layers, options)
    margin = travel_px(exposure, layers, options)
    canvases = [paint(rng, layer, K, options.size, margin, options.detail) for layer in layers]
    return Video(exposure=exposure, canvases=canvases, share=options.exposure_share)


def render_sequence(seed: int, folder: Path, options: SequenceOptions | None = None) -> SequenceTruth:
    """Render a video into a folder; return its truth, which is written beside the frames.

    Parameters
    ----------
    seed : int
        Decides everything.
    folder : Path
        Created if needed.
    options : SequenceOptions, optional
    """
    options = options or SequenceOptions()
    video, times = paint_video(seed, options), instants(options)
    folder.mkdir(parents=True, exist_ok=True)
    smears = []
    like = compose(video.canvases, [f[len(KNOTS) // 2] for f in video.fields(0.0)], options.size)
    for index, middle in enumerate(times):
        fields = video.fields(middle)
        linear = mean_frame(video.canvases, fields, options.size)
        picture = sharp_photograph(np.random.default_rng([seed, index]), linear, like)
        cv2.imwrite(str(folder / f"frame_{index:03d}.png"), picture[..., ::-1])
        smears.append(video.displacement(middle, fields))
    truth = SequenceTruth(K=video.exposure.K, poses=video.poses(times), displacement=np.stack(smears))
    np.savez(folder / "truth.npz", K=truth.K, poses=truth.poses, displacement=truth.displacement)
    return truth


def read_sequence(folder: Path) -> tuple[list[Path], SequenceTruth]:
    """Return what `render_sequence` wrote: the frames' paths, in order, and the truth.

    Blur2ViewError if there is none.
    """
    if not (folder / "truth.npz").exists():
        raise Blur2ViewError(f"{folder}: no sequence; run python -m tools.rendering.sequence {folder}")
    with np.load(folder / "truth.npz") as truth:
        return sorted(folder.glob("frame_*.png")), SequenceTruth(**truth)


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--frames", type=int, default=SequenceOptions.frames)
    parser.add_argument("--photos", type=existing, help="folder of further photographs used as textures")
    parser.add_argument("--size", type=int, nargs=2, default=SequenceOptions.size)
    arguments = parser.parse_args()
    size = (arguments.size[0], arguments.size[1])
    options = SequenceOptions(frames=arguments.frames, size=size, photos=arguments.photos)
    truth = render_sequence(arguments.seed, arguments.folder, options)
    print(f"{arguments.folder}: median smears {np.round(truth.smear_px, 1).tolist()} px")


if __name__ == "__main__":
    main()
