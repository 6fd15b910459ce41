"""Blurred photographs of surfaces at depths and of things that move by themselves, with exact truth.

A scene is up to six layers, the background first: a piece of a photograph, or a thing, with an outline and
the displacement that a moving camera gives it at its inverse depth, plus a motion of its own where it
moves by itself. Other layers stand still nearer than the background, so that depth alone is no mover.

A point x of a layer, the middle of its chord, stands at x + s(t) D(x) + bend (t^2 - 1/4) at times t from -1/2
to 1/2, where s(t) = t + a (t^2 - 1/4) and D is the layer's displacement. Every pixel of every sub-frame
follows each layer back to mid exposure, and light is summed front to back: by torch, on a processor (0.5 s
for three layers of 512 x 384 pixels) or a GPU.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor
from torch.nn import functional as nnf

from blur2view.arrays import Array, Floats, Mask
from tools.rendering.sensor import defocused, log_uniform

Pictures = list[NDArray[np.uint8]]
Size = tuple[int, int]

KINDS = ("camera", "deep", "follow", "cross", "rest", "unmoved", "shallow")
"""The camera moves; it moves before much depth; it follows things; things cross its view; things move before
a camera at rest; nothing moves; nothing moves and the background of sharp things is out of focus."""
SHARES = (0.16, 0.19, 0.16, 0.16, 0.16, 0.07, 0.1)
"""Shares of the kinds in training."""
BLOCK_PX, GRID = 4, 16
"""Pixels between the blocks of the truth, and between values of displacement fields."""
STEPS_AT_ONCE = 16
"""Sub-frames that are computed together, which bounds the memory."""
MAX_LAYERS, MAX_STEPS, MIN_STEPS = 6, 360, 9
FONT, FONT_PX = Path("/usr/share/fonts/truetype/noto/NotoColorEmoji.ttf"), 109
EMOJI = (
    (0x1F400, 0x1F43F), (0x1F466, 0x1F487), (0x1F574, 0x1F57B), (0x1F680, 0x1F6B6), (0x1F6E9, 0x1F6FC),
    (0x1F930, 0x1F93E), (0x1F980, 0x1F9AE), (0x1F9B8, 0x1F9DF), (0x1F330, 0x1F343), (0x1F3A0, 0x1F3CC),
    (0x1F446, 0x1F450), (0x1F339, 0x1F33F), (0x1F6F4, 0x1F6FA), (0x1FAB0, 0x1FABA),
)  # fmt: skip
"""Code points of people, animals, vehicles, plants, hands and things that are carried about."""
COVERED = 0.08, 0.85  # bounds of the share of its box that a thing covers


@dataclass(frozen=True, kw_only=True)
class Sources:
    """Photographs (h, w, 3) and things (h, w, 4) that scenes are made of, uint8 RGB and RGBA."""

    photographs: Pictures
    things: Pictures


@dataclass(frozen=True, kw_only=True, eq=False)
class LayerScene:
    """A picture in linear light (H, W, 3), and its truth at blocks of 4 x 4 pixels (H/4, W/4), float32.

    ``moving`` is the share of what is seen that moves by itself. Of the surface that is seen most ``share``
    is its share, ``displacement`` (H/4, W/4, 2) and ``radius_px``, out of focus, are in pixels.
    """

    linear: Floats
    displacement: Floats
    moving: Floats
    share: Floats
    radius_px: Floats
    kind: str

    @property
    def camera_moved(self) -> float:
        """1 if the camera's motion shows, 0 if it stood still; between for smears of 0.7 to 1.7 px."""
        if self.kind in ("rest", "unmoved", "shallow"):
            return 0.0
        length = float(np.median(np.linalg.norm(self.displacement, axis=-1)))
        return float(np.clip(length - 0.7, 0, 1))


def silhouettes() -> Pictures:
    """Return the things of an emoji font (h, w, 4), cut to their outlines."""
    drawn, found = ImageFont.truetype(str(FONT), FONT_PX), []
    for code in (code for first, last in EMOJI for code in range(first, last + 1)):
        canvas = Image.new("RGBA", (150, 150))
        ImageDraw.Draw(canvas).text((7, 7), chr(code), font=drawn, embedded_color=True)
        picture = np.asarray(canvas)
        rows, columns = np.nonzero(picture[..., 3] > 127)
        if len(rows) >= 500:
            cut = picture[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
            if COVERED[0] < (cut[..., 3] > 127).mean() < COVERED[1]:
                found.append(cut)
    return found


def layer_scene(
    rng: np.random.Generator,
    sources: Sources,
    size: Size,
    *,
    kind: str | None = None,
    longest_px: float = 40.0,
    focus_share: float = 0.2,
    radius_px: tuple[float, float] = (0.8, 10.0),
    device: str = "cpu",
) -> LayerScene:
    """Return a scene of a size (width, height, multiples of 4) whose smears have at most ``longest_px``.

    A ``focus_share`` of scenes, and half of those in which nothing moves, is out of focus by ``radius_px``,
    log-uniform: the whole picture, the things, or the background.
    """
    kind = kind or KINDS[int(rng.choice(len(KINDS), p=SHARES))]
    if kind == "shallow":
        return shallow_scene(rng, sources, size)
    margin = -(-(int(0.75 * longest_px) + 16) // GRID) * GRID
    fields, moves, length = displacements(rng, size, kind, longest_px, margin)
    shape = size[1] + 2 * margin, size[0] + 2 * margin
    focus_share = max(focus_share, 0.5) if kind == "unmoved" else focus_share
    radius = log_uniform(rng, radius_px) if rng.random() < focus_share else 0.0
    all_soft, colours, radii = rng.random() < 0.5, [], []
    for k in range(len(fields)):
        front = surface(rng, sources, shape, size, k == 0)
        soft = all_soft or (k == 0) == (radius > 3)  # large discs: of the background
        colours.append(defocused(rng, front, radius) if radius and soft else front)
        radii.append(radius if soft else 0.0)
    reach = min(1.3 * float(np.abs(fields).max()), 1.5 * longest_px)
    light, seen = swept(
        np.stack(colours).astype(np.float32),
        fields,
        size,
        steps=1 if reach < 0.05 else min(MAX_STEPS, max(MIN_STEPS, int(1.1 * reach) + 2)),
        bend=rng.normal(0, 0.08, 2) * length if rng.random() < 0.4 else np.zeros(2),
        acceleration=float(np.clip(rng.normal(0, 0.22), -0.6, 0.6)) if rng.random() < 0.5 else 0.0,
        device=device,
    )
    blocks = size[0] // BLOCK_PX, size[1] // BLOCK_PX
    shares = np.stack([cv2.resize(one, blocks, interpolation=cv2.INTER_AREA) for one in seen])
    y, x = (margin + BLOCK_PX * np.mgrid[: blocks[1], : blocks[0]] + 1.5).astype(np.float32) / GRID
    each = np.stack([cv2.remap(field, x, y, cv2.INTER_LINEAR) for field in fields])
    most = shares.argmax(0)
    return LayerScene(
        linear=light,
        displacement=np.take_along_axis(each, most[None, ..., None], 0)[0],
        moving=shares[moves].sum(0),
        share=shares.max(0),
        radius_px=np.array(radii, np.float32)[most],
        kind=kind,
    )


def shallow_scene(rng: np.random.Generator, sources: Sources, size: Size) -> LayerScene:
    """Return a scene in which nothing moves: a photograph out of focus by depth, or things before it."""
    shape, largest = size[::-1], log_uniform(rng, (2.0, 14.0))
    photograph = texture(rng, sources, shape)
    y, x = (np.mgrid[: shape[0], : shape[1]].T / size).T
    angle, centre = rng.uniform(0, 2 * np.pi), rng.normal(0.5, 0.15, 2)
    slope = 0.5 + rng.uniform(0, 1) * ((x - 0.5) * np.cos(angle) + (y - 0.5) * np.sin(angle))
    hollow = np.hypot(x - centre[0], y - centre[1]) / rng.uniform(0.3, 0.7) - rng.uniform(0.2, 0.5)
    is_subject = rng.random() < 0.25  # the photograph's own middle
    depth = (hollow if is_subject else slope) + rng.uniform(0, 0.35) * relief(rng, shape, 4)
    light = np.zeros_like(photograph)
    layer, shares = 3 * np.clip(depth, 0, 1), (0.0 if is_subject else 0.2, 0.35, 0.7, 1.0)
    for k, share in enumerate(shares):
        weight = np.clip(1 - np.abs(layer - k), 0, 1).astype(np.float32)
        light += weight[..., None] * defocused(rng, photograph, share * largest)
    radius = (np.interp(layer, range(4), shares) * largest).astype(np.float32)
    fronts = [rng.uniform(0.2, 1.2) * largest] * int(rng.integers(0, 3)) + [0.0] * int(rng.integers(1, 3))
    for own in [] if is_subject else fronts:
        front = defocused(rng, surface(rng, sources, shape, size, False), own)
        light = light * (1 - front[..., 3:]) + front[..., :3]
        radius[front[..., 3] > 0.5] = own
    still = np.zeros((shape[0] // BLOCK_PX, shape[1] // BLOCK_PX), np.float32)
    return LayerScene(
        linear=light,
        displacement=np.zeros((*still.shape, 2), np.float32),
        moving=still,
        share=still + 1,
        radius_px=cv2.resize(radius, still.shape[::-1], interpolation=cv2.INTER_AREA),
        kind="shallow",
    )


def displacements(
    rng: np.random.Generator, size: Size, kind: str, longest_px: float, margin: int
) -> tuple[Floats, Mask, float]:
    """Draw the layers' displacements (L, gh, gw, 2), which of them move, and the camera's smear length."""
    width, height = size
    rows, columns = ((side + 2 * margin) // GRID + 1 for side in (height, width))
    left, top = margin + (width - 1) / 2, margin + (height - 1) / 2
    x, y = np.meshgrid(np.arange(columns) * GRID - left, np.arange(rows) * GRID - top)
    inner = (np.abs(x) < width / 2) & (np.abs(y) < height / 2)
    least = 1.2 if kind in ("camera", "deep") else 3.0
    length = log_uniform(rng, (least, longest_px if rng.random() < 0.6 else min(20.0, longest_px)))
    if kind in ("rest", "unmoved"):
        length = rng.uniform(0, 0.8) if kind == "rest" and rng.random() < 0.3 else 0.0
    depth = inverse_depth(rng, x / width, y / height, rough=kind == "deep")
    turn, step = rng.standard_normal((2, 3)) * (1, 1, 0.7)
    mix = rng.random()
    step *= 0.0 if kind != "deep" and mix < 0.4 else 0.3 if mix < 0.6 else 1.0
    turn *= 0.0 if mix > 0.85 else 1.0
    focal = width * rng.uniform(0.6, 2.2)
    unit = motion_field(x / focal, y / focal, turn, step, depth) * focal
    scale = length / max(float(np.median(np.hypot(*unit)[inner])), 1e-9)

    def still(rho: Array) -> Array:
        return motion_field(x / focal, y / focal, turn * scale, step * scale, rho) * focal

    def nearer() -> Array:
        return still(np.full_like(x, float(np.median(depth)) * rng.uniform(1.0, 2.6)))

    def own(px: float) -> Array:
        return own_motion(rng, x, y, size, px)

    back = still(depth)
    layers = [(back, False)]
    if kind == "deep":
        layers += [(nearer(), False) for _ in range(rng.integers(1, 4))]
    elif kind == "follow":
        rest = length * (rng.uniform(0.1, 0.4) if rng.random() < 0.4 else rng.uniform(0, 0.08))
        layers += [(own(rest), True)] * (1 if rng.random() < 0.75 else 2)
    elif kind == "cross":
        for _ in range(rng.integers(1, 4)):
            base = nearer() if rng.random() < 0.5 else back
            layers.append((base + own(max(2.0, length * rng.uniform(0.3, 1.6))), True))
    elif kind == "rest":
        layers += [(back + own(log_uniform(rng, (3.0, longest_px))), True) for _ in range(rng.integers(1, 5))]
    else:
        layers += [(back, False)] * int(rng.integers(0, 3) if kind == "unmoved" else rng.random() < 0.3)
    if any(moves for _, moves in layers):
        if rng.random() < 0.3:  # a part of the nearest that moves otherwise
            layers.append((layers[-1][0] + own(0.5 * log_uniform(rng, (3.0, longest_px))), True))
        for _ in range(rng.integers(1, 3) if rng.random() < 0.4 else 0):  # what stands among them
            at = int(rng.integers(1, len(layers) + 1))
            layers.insert(at, (nearer() if rng.random() < 0.7 else back, False))
    del layers[MAX_LAYERS:]
    fields = np.stack([field for field, _ in layers]).astype(np.float32)
    fields *= min(1.0, 1.2 * longest_px / max(float(np.abs(fields[:, :, inner]).max()), 1e-9))
    fields = np.ascontiguousarray(np.moveaxis(fields, 1, -1))
    return fields, np.array([moves for _, moves in layers]), length


def inverse_depth(rng: np.random.Generator, x: Array, y: Array, rough: bool) -> Array:
    """Draw inverse depths of a surface at x, y: even, slanted, or rough."""
    depth = np.ones_like(x)
    if rng.random() < 0.6:
        depth += rng.normal(0, 0.35) * x + rng.normal(0, 0.35) * y
    if rng.random() < (0.55 if rough else 0.25):
        depth += rng.uniform(0.05, 0.7) * relief(rng, x.shape, int(rng.integers(2, 7)))
    return np.asarray(np.clip(depth, 0.08, 4))


def motion_field(x: Array, y: Array, turn: Array, step: Array, depth: Array) -> Array:
    """Return the instantaneous motion (2, h, w) of rays x, y at inverse depths (Longuet-Higgins, 1980)."""
    u = x * y * turn[0] - (1 + x * x) * turn[1] + y * turn[2] + depth * (x * step[2] - step[0])
    v = (1 + y * y) * turn[0] - x * y * turn[1] - x * turn[2] + depth * (y * step[2] - step[1])
    return np.stack([u, v])


def own_motion(rng: np.random.Generator, x: Array, y: Array, size: Size, px: float) -> Array:
    """Draw a motion (2, h, w) of about ``px`` pixels: a shift, in half of the cases with a turn or a zoom."""
    angle = rng.uniform(0, 2 * np.pi)
    motion = np.stack([np.full_like(x, px * np.cos(angle)), np.full_like(x, px * np.sin(angle))])
    if rng.random() < 0.5:
        rate = np.clip(rng.normal(0, 1) * rng.choice([0.1, 0.3, 0.8]) * px / size[1], -0.4, 0.4)
        dx, dy = (p - rng.uniform(-0.3, 0.3) * side for p, side in zip((x, y), size, strict=True))
        motion += rate * np.stack([-dy, dx] if rng.random() < 0.5 else [dx, dy])
    return motion


def relief(rng: np.random.Generator, shape: tuple[int, ...], cells: int) -> Floats:
    """Draw smooth noise (h, w) with this number of cells down."""
    coarse = rng.standard_normal((max(2, cells), max(2, round(cells * shape[1] / shape[0]))))
    return np.asarray(cv2.resize(coarse.astype(np.float32), shape[1::-1], interpolation=cv2.INTER_CUBIC))


def surface(
    rng: np.random.Generator, sources: Sources, shape: Size, size: Size, is_background: bool
) -> Floats:
    """Draw a layer (h, w, 4): linear light times coverage, and coverage."""
    plain = log_uniform(rng, (0.02, 0.5)) if rng.random() < (0.12 if is_background else 0.25) else 1.0
    light = texture(rng, sources, shape)
    mean = light.mean((0, 1))
    light = mean + np.float32(plain) * (light - mean)
    if is_background:
        return np.dstack([light, np.ones(shape, np.float32)])
    cover, colours = outline(rng, sources, shape, size, log_uniform(rng, (0.006, 0.4)))
    light = light if colours is None else colours
    return np.dstack([light * cover[..., None], cover]).astype(np.float32)


def turned(angle: float, across: float, down: float) -> Array:
    """Return the matrix (2, 2) that stretches both axes and then turns them, radians."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.asarray(turn @ np.diag([across, down]))


def texture(rng: np.random.Generator, sources: Sources, shape: Size) -> Floats:
    """Return a piece of a photograph (h, w, 3), mirrored, reduced or slightly turned, as linear light."""
    photograph = sources.photographs[int(rng.integers(len(sources.photographs)))]
    if rng.random() < 0.45:
        photograph = np.asarray(cv2.resize(photograph, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    zoom = rng.uniform(1.0, 1.3) if rng.random() < 0.5 else 1.0
    angle = rng.normal(0, 0.04) if rng.random() < 0.3 else 0.0
    matrix = turned(angle, rng.choice([-zoom, zoom]), zoom * (1 if rng.random() < 0.75 else -1))
    sides = np.array(photograph.shape[1::-1])
    free = np.maximum(sides - zoom * np.array(shape[::-1]), 0) / 2
    middle = sides / 2 + rng.uniform(-1, 1, 2) * free - matrix @ (np.array(shape[::-1]) / 2)
    affine = np.column_stack([matrix, middle])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    piece = cv2.warpAffine(photograph, affine, shape[::-1], flags=flags, borderMode=cv2.BORDER_REFLECT)
    return np.asarray((piece / np.float32(255)) ** np.float32(2.2))


def outline(
    rng: np.random.Generator, sources: Sources, shape: Size, size: Size, area: float
) -> tuple[Floats, Floats | None]:
    """Draw the coverage (h, w) of a layer, ``area`` of the picture, and a thing's own light, or None."""
    which, pixels = rng.random(), area * size[0] * size[1]
    if which < 0.12:  # blobs
        noise = relief(rng, shape, int(rng.integers(4, 12)))
        level = np.float32(np.quantile(noise[::4, ::4], 1 - area))
        return np.asarray(np.clip((noise - level) * 12 + 0.5, 0, 1), np.float32), None
    middle = np.array(shape[::-1]) / 2 + rng.normal((0, 0.02), (0.2, 0.18)) * size
    if which < 0.27 or not sources.things:  # polygons
        count = int(rng.integers(3, 12))
        angle = np.sort(rng.uniform(0, 2 * np.pi, count))
        radius = np.sqrt(pixels / np.pi) * rng.uniform(0.6, 1.5, count)
        corners = middle + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        canvas = np.zeros(shape, np.uint8)
        cv2.fillPoly(canvas, [np.round(corners * 16).astype(np.int32)], 255, cv2.LINE_AA, 4)
        return np.asarray(canvas / np.float32(255), np.float32), None
    thing = sources.things[int(rng.integers(len(sources.things)))]
    scale = float(np.sqrt(pixels / max(float(thing[..., 3].sum()) / 255, 1.0)))
    if scale < 0.7:
        thing = np.asarray(cv2.resize(thing, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
        scale = 1.0
    stretch, tilt = np.exp(rng.normal(0, 0.18)), rng.normal(0, 0.3)
    matrix = turned(tilt, scale * stretch * rng.choice([-1, 1]), scale / stretch)
    affine = np.column_stack([matrix, middle - matrix @ (np.array(thing.shape[1::-1]) / 2)])
    drawn = cv2.warpAffine(thing, affine, shape[::-1], flags=cv2.INTER_CUBIC).astype(np.float32) / 255
    cover = np.asarray(np.clip((drawn[..., 3] - 0.5) * max(scale, 1.0) + 0.5, 0, 1), np.float32)
    own = np.asarray(np.maximum(drawn[..., :3], 0) ** 2.2, np.float32)
    return cover, own if rng.random() < 0.5 else None


def swept(
    colour: Floats,
    displacement: Floats,
    size: Size,
    *,
    steps: int,
    bend: Array,
    acceleration: float = 0.0,
    device: str = "cpu",
) -> tuple[Floats, Floats]:
    """Return the mean light (H, W, 3) of sub-frames of layers and the shares (L, H, W) that are seen of them.

    ``colour`` (L, h, w, 4), the furthest layer first, is linear light times coverage, and coverage, with a
    margin about ``size`` (width, height). ``displacement`` (L, gh, gw, 2), every `GRID` pixels, and the
    ``bend`` (2,) of all paths are in pixels; ``acceleration`` is the a of s(t).
    """
    margin = (colour.shape[1] - size[1]) // 2
    layers, fields = (torch.from_numpy(x).to(device).permute(0, 3, 1, 2) for x in (colour, displacement))
    y, x = torch.meshgrid(*(torch.arange(n, device=device) for n in size[::-1]), indexing="ij")
    pixels, curve = torch.stack([x, y], -1) + margin, torch.tensor(bend, device=device)
    light, seen = torch.zeros(3, *x.shape, device=device), torch.zeros(len(layers), *x.shape, device=device)
    t = (torch.arange(steps, device=device) + 0.5)[:, None, None, None] / steps - 0.5
    for some in t.split(STEPS_AT_ONCE):
        q = some * some - 0.25
        s, start = some + acceleration * q, (pixels - curve * q).float()
        left = torch.full(start.shape[:3], 1 / steps, device=device)
        for layer in range(len(layers) - 1, -1, -1):
            at = start
            for _ in range(2):  # x + s D(x) = p, by iteration
                at = start - s * sampled(fields[layer], at / GRID).permute(0, 2, 3, 1)
            shown = sampled(layers[layer], at)
            light += (left[:, None] * shown[:, :3]).sum(0)
            part = left * shown[:, 3]
            seen[layer] += part.sum(0)
            left = left - part
    return light.permute(1, 2, 0).cpu().numpy(), seen.cpu().numpy()


def sampled(values: Tensor, at: Tensor) -> Tensor:
    """Return values (C, h, w) at positions x, y (n, H, W, 2): (n, C, H, W); beyond the border as on it."""
    sides = torch.tensor(values.shape[:0:-1], device=values.device) - 1
    every = values.expand(len(at), *values.shape)
    return nnf.grid_sample(every, 2 * at / sides - 1, padding_mode="border", align_corners=True)
