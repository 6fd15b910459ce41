"""Photographs and textures at native sharpness under a moving camera: exact smears, no rendering of scenes.

A picture is one surface, with up to four movers before it, whose points move by a field of smears that is
affine in the picture (a rotation, a zoom, a slanted plane, a rolling shutter are, locally), along paths that
may be curved and accelerated; sub-frames are averaged in linear light. Surfaces may be out of focus, each by
a radius of its own.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from blur2view.arrays import AnyArray as Array
from tools.rendering.defocus import defocused
from tools.rendering.layers import Path, blob, composed, sample_path, smears_of, surface
from tools.rendering.sensor import SensorOptions, compress, expose, log_uniform, photograph, soften, tone


@dataclass(frozen=True, kw_only=True)
class ShakeOptions:
    """What a shaken picture of ``size`` (width, height in pixels, multiples of 4) may be.

    ``smear_px`` and ``short_px`` are ranges of the smear at the middle, log-uniform; a ``short_share`` of
    moving pictures takes the second. Further shares are of pictures without motion, with one to four surfaces
    that move otherwise (each of ``mover_area`` of the picture, log-uniform), scaled up after the sensor,
    smoothed with edges kept, compressed twice, photographed larger as the smaller octaves are. A
    ``rest_share`` shows one to four movers before a camera at rest, half of them before the smoothest part of
    a surface. A ``focus_share`` is out of focus by ``radius_px``, log-uniform: as a whole, or, a
    ``layered_share`` of it, in layers, a sharp one before others or behind; a ``focus_still_share`` of these
    pictures does not move.
    """

    size: tuple[int, int] = (640, 512)
    smear_px: tuple[float, float] = (1.2, 180.0)
    short_px: tuple[float, float] = (2.0, 14.0)
    short_share: float = 0.5
    still_share: float = 0.33
    mover_share: float = 0.4
    mover_area: tuple[float, float] = (0.03, 0.4)
    upscaled_share: float = 0.12
    denoised_share: float = 0.12
    twice_share: float = 0.15
    reduced_share: float = 0.25
    rest_share: float = 0.17
    focus_share: float = 0.5
    focus_still_share: float = 0.5
    layered_share: float = 0.4
    radius_px: tuple[float, float] = (0.7, 20.0)

    def sensor(self, softness_px: float) -> SensorOptions:
        """Return the cameras: mosaics as unbalanced as on a sensor, halos of sharpening, grain.

        Their point spread has this standard deviation, and their lenses are in focus: what is not is known.
        """
        softness = (softness_px, softness_px)
        return SensorOptions(
            softness_px=softness,
            defocus_share=0.0,
            unbalanced_share=0.6,
            sharpening=(0.2, 2.0),
            grain_share=0.3,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Shaken:
    """A picture and what is true of it.

    Mean radiance ``linear`` (H, W, 3); on the grid of 4 x 4 pixels (H/4, W/4): ``displacement`` (..., 2) and
    the radius out of focus ``radius_px`` of what is seen most there, and where they are ``valid``: smears
    that stay within the picture on one surface.
    """

    linear: Array
    displacement: Array
    radius_px: Array
    valid: Array


def sample_paths(rng: np.random.Generator, options: ShakeOptions) -> list[Path]:
    """Draw the path of the picture's surface and, in some, those of movers before it."""
    if options.rest_share and rng.random() < options.rest_share:
        lengths = [0.0, *(log_uniform(rng, options.smear_px) for _ in range(rng.integers(1, 5)))]
        return [sample_path(rng, length, options.size[1]) for length in lengths]
    still = rng.random() < options.still_share
    bounds = options.short_px if rng.random() < options.short_share else options.smear_px
    length = 0.0 if still else log_uniform(rng, bounds)
    lengths = [length]
    if rng.random() < options.mover_share * (0.5 if still else 1):
        for _ in range(rng.integers(1, 5)):
            other = log_uniform(rng, bounds) if still else length * rng.uniform(0.3, 2.0)
            at_rest = not still and rng.random() < 0.2  # a camera that follows what moves
            lengths.append(0.0 if at_rest else min(other, options.smear_px[1]))
    return [sample_path(rng, length, options.size[1]) for length in lengths]


def cut_out(rng: np.random.Generator, image: Array, options: ShakeOptions) -> Array:
    """Give a surface (h, w, 3) an outline drawn at its middle: (h, w, 4), colours multiplied by it."""
    (width, height), area = options.size, log_uniform(rng, options.mover_area)
    outline = np.zeros(image.shape[:2], np.float32)
    y, x = (image.shape[0] - height) // 2, (image.shape[1] - width) // 2
    if y >= 0 and x >= 0:
        outline[y : y + height, x : x + width] = blob(rng, width, height, area)
    else:
        outline = blob(rng, image.shape[1], image.shape[0], area)
    return np.dstack([image * outline[..., None], outline])


def sample_radii(rng: np.random.Generator, paths: list[Path], options: ShakeOptions) -> list[float]:
    """Draw the radii out of focus of surfaces; append a path like the first's where a layer is wanted."""
    if not options.focus_share or rng.random() >= options.focus_share:
        return [0.0] * len(paths)
    radius = log_uniform(rng, options.radius_px)
    if rng.random() >= options.layered_share:
        return [radius] * len(paths)
    if len(paths) == 1:
        paths.append(paths[0])
    sharp = int(rng.integers(len(paths))) if rng.random() < 0.5 else 0
    return [0.0 if k == sharp else radius * rng.uniform(0.5, 1) for k in range(len(paths))]


def shake(rng: np.random.Generator, sources: list[Array], options: ShakeOptions) -> Shaken:
    """Make one picture of photographs (H, W, 3) uint8."""
    width, height = options.size
    paths = sample_paths(rng, options)
    radii = sample_radii(rng, paths, options)
    if any(radii) and rng.random() < options.focus_still_share:
        paths = [sample_path(rng, 0.0, height)] * len(paths)
    _, longest = smears_of(paths, options.size)
    margin = int(0.75 * longest + max(radii)) + 8
    at_rest = options.rest_share > 0 and len(paths) > 1 and not paths[0].shift.any()
    tries = 8 if at_rest and rng.random() < 0.5 else 1
    layers = []
    for k, radius in enumerate(radii):
        source = sources[int(rng.integers(len(sources)))]
        layer = surface(rng, source, width, height, margin, 1 if k else tries)
        layers.append(defocused(rng, cut_out(rng, layer, options) if k else layer, radius))
    linear, shares, most, displacement = composed(layers, paths, options.size)
    return Shaken(
        linear=linear,
        displacement=displacement,
        radius_px=np.array(radii, np.float32)[most],
        valid=shares.max(0) > 0.9,
    )


def processed(rng: np.random.Generator, linear: Array, options: ShakeOptions) -> tuple[Array, float]:
    """Photograph radiance (H, W, 3) and process it as phones, videos and web sites do.

    Return the picture, uint8 RGB or float32 on its scale, and the radius of the disc that spreads as widely
    as the camera does, pixels.
    """
    height, width = linear.shape[:2]
    softness = rng.uniform(0.0, 1.2)
    if rng.random() < options.reduced_share:
        return reduced(rng, linear, options, softness)
    spread = 2 * softness
    if rng.random() < options.upscaled_share:
        factor = rng.uniform(1.15, 2.5)
        size = (round(width / factor), round(height / factor))
        small = cv2.resize(linear, size, interpolation=cv2.INTER_AREA)
        image = photograph(rng, np.asarray(small), options.sensor(softness))
        how = cv2.INTER_CUBIC if rng.random() < 0.6 else cv2.INTER_LINEAR
        image = np.asarray(cv2.resize(image, (width, height), interpolation=how))
        spread = float(np.hypot(spread * factor, UPSCALED * np.sqrt(factor**2 - 1)))
    else:
        image = photograph(rng, linear, options.sensor(softness))
    if rng.random() < options.denoised_share:
        image = np.asarray(cv2.bilateralFilter(image, 5, rng.uniform(8, 40), rng.uniform(1, 3)))
    if rng.random() < options.twice_share:
        image = compress(rng, image)
    return image, spread


UPSCALED = 0.8
"""Radius of the disc that spreads as widely as pixels that were far larger, over their side."""


def reduced(
    rng: np.random.Generator, linear: Array, options: ShakeOptions, softness: float
) -> tuple[Array, float]:
    """Photograph as a larger picture and reduce that, as octaves are: float32 on the scale of uint8.

    Half of the time by two; else by much more, which leaves hardly any noise. Also return the radius of the
    camera's spread, as `processed` does.
    """
    height, width = linear.shape[:2]
    if rng.random() < 0.5:
        large = cv2.resize(linear, (2 * width, 2 * height), interpolation=cv2.INTER_CUBIC)
        image = photograph(rng, np.maximum(np.asarray(large), 0), options.sensor(softness))
        small = cv2.resize(image.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
        return np.asarray(small), softness
    softness /= 2
    lens = SensorOptions(softness_px=(softness, softness), defocus_share=0.0)
    signal = soften(rng, expose(rng, linear.astype(np.float32)), lens)
    coded = np.clip(tone(rng, np.clip(signal, 0, 1)), 0, 1)
    noise = rng.standard_normal(coded.shape, dtype=np.float32)
    noise *= np.float32(np.exp(rng.uniform(np.log(1e-4), np.log(2e-3))))
    return np.asarray((np.clip(coded + noise, 0, 1) * 255).astype(np.float32)), 2 * softness
