"""From radiance to a coded photograph: lenses, exposure, mosaic, noise, tone, sharpening, compression."""

from dataclasses import dataclass

import cv2
import numpy as np

from blur2view.arrays import AnyArray

SPREADS = ("disc", "blades", "gaussian", "ring")
SPREAD_SHARES = (0.45, 0.25, 0.18, 0.12)
"""Point spreads of lenses out of focus, and how often each is drawn."""
ELLIPTIC_SHARE, LEAST_AXIS = 0.3, 0.75
"""Share of point spreads that are squeezed, as off a lens's axis, and by how much at most."""


UPSCALED = 0.8
"""Radius of the disc that spreads as widely as pixels that were far larger, over their side."""
UPSCALED_SHARE, DENOISED_SHARE, TWICE_SHARE, REDUCED_SHARE = 0.12, 0.12, 0.15, 0.25
"""Shares of pictures that were scaled up, smoothed with edges kept, compressed twice, photographed larger."""


@dataclass(frozen=True, kw_only=True)
class SensorOptions:
    """Which effects may occur; the defaults are those of test sets. Shares are of images."""

    softness_px: tuple[float, float] = (0.0, 1.4)  # standard deviation of the optical point spread
    read_noise: tuple[float, float] = (3e-4, 6e-3)  # standard deviation in the dark; log-uniform
    shot_noise: tuple[float, float] = (1e-5, 1e-3)  # variance per unit signal; log-uniform
    jpeg_share: float = 0.75
    defocus_share: float = 0.14  # out of focus by a disc of up to 6 px radius
    unbalanced_share: float = 0.0  # clipped and interpolated before the white balance
    sharpening: tuple[float, float] = (0.2, 1.2)  # strength of unsharp masking
    grain_share: float = 0.0  # grey noise a few pixels wide; sharpened along one axis, as videos are


def log_uniform(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    """Return a number between two positive bounds, uniform in the logarithm."""
    return float(np.exp(rng.uniform(np.log(bounds[0]), np.log(bounds[1]))))


def expose(rng: np.random.Generator, linear: AnyArray) -> AnyArray:
    """Return radiance after gain and white balance, its mean level between dim and overexposed."""
    level = float(np.exp(rng.normal(np.log(0.25), 0.6)))
    gain = level / max(float(linear.mean()), 1e-3)
    return np.asarray(linear * (gain * rng.uniform(0.85, 1.18, 3)).astype(np.float32))


def soften(rng: np.random.Generator, linear: AnyArray, options: SensorOptions) -> AnyArray:
    """Return the picture after an optical point spread; now and then defocus, which is no motion."""
    if rng.random() < options.defocus_share:
        radius = log_uniform(rng, (0.8, 6.0))
        reach = int(np.ceil(radius)) + 1
        y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
        disc = np.clip(radius + 0.5 - np.hypot(x, y), 0, 1).astype(np.float32)
        blurred = cv2.filter2D(linear, -1, disc / disc.sum(), borderType=cv2.BORDER_REFLECT)
        linear = np.asarray(blurred)
    sigma = rng.uniform(*options.softness_px)
    return gaussian(linear, sigma) if sigma > 0.2 else linear


def gaussian(image: AnyArray, sigma_px: float) -> AnyArray:
    """Return the picture blurred by a Gaussian."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px))


def add_noise(rng: np.random.Generator, signal: AnyArray, options: SensorOptions) -> AnyArray:
    """Return linear light with shot and read noise, clipped at black and white."""
    read, shot = log_uniform(rng, options.read_noise), log_uniform(rng, options.shot_noise)
    deviation = np.sqrt(np.maximum(signal, 0) * np.float32(shot) + np.float32(read**2))
    noise = rng.standard_normal(signal.shape, dtype=np.float32)
    return np.asarray(np.clip(signal + deviation * noise, 0, 1))


def demosaic(signal: AnyArray, edges: bool = False) -> AnyArray:
    """Return RGB (H, W, 3) in [0, 1], sampled as a Bayer mosaic and interpolated linearly, or along edges."""
    mosaic = signal[..., 1].copy()
    mosaic[0::2, 0::2] = signal[0::2, 0::2, 0]
    mosaic[1::2, 1::2] = signal[1::2, 1::2, 2]
    coded = np.asarray(np.clip(mosaic, 0, 1) * 65535 + 0.5).astype(np.uint16)
    # OpenCV names RGGB by its second row and column
    rgb = cv2.cvtColor(coded, cv2.COLOR_BayerBG2BGR_EA if edges else cv2.COLOR_BayerBG2BGR)
    return np.asarray(rgb[..., ::-1].astype(np.float32) / 65535)


def demosaic_unbalanced(rng: np.random.Generator, signal: AnyArray) -> AnyArray:
    """Return the same of a sensor that sees less red and blue than green: clipped first, balanced last."""
    balance = np.array([rng.uniform(1.2, 2.4), 1.0, rng.uniform(1.2, 2.4)], np.float32)
    raw = np.clip(signal * np.float32(rng.uniform(1.0, 1.6)) / balance, 0, 1)
    return np.asarray(np.clip(demosaic(raw, edges=rng.random() < 0.4) * balance, 0, 1))


def blotches(rng: np.random.Generator, shape: tuple[int, ...]) -> AnyArray:
    """Return factors (H, W, 3) about 1: coarse coloured noise, as denoising and videos leave it."""
    small = rng.standard_normal((-(-shape[0] // 2), -(-shape[1] // 2), 3), dtype=np.float32)
    coarse = np.asarray(cv2.resize(gaussian(small, rng.uniform(0.6, 1.5)), shape[1::-1]))
    return np.asarray(1 + np.float32(rng.uniform(0.01, 0.1)) * (coarse - coarse.mean(2, keepdims=True)))


def tone(rng: np.random.Generator, linear: AnyArray) -> AnyArray:
    """Return sRGB coding or a camera's own curve: another gamma and an S of varying strength."""
    if rng.random() < 0.4:
        curve = 1.055 * np.maximum(linear, 1e-6) ** (1 / 2.4) - 0.055
        return np.where(linear <= 0.0031308, 12.92 * linear, curve)
    coded = np.maximum(linear, 1e-6) ** np.float32(1 / rng.uniform(1.8, 2.6))
    strength = np.float32(rng.uniform(0, 0.8))
    return np.asarray(coded + strength * (coded * coded * (3 - 2 * coded) - coded))


def sharpen(rng: np.random.Generator, coded: AnyArray, options: SensorOptions) -> AnyArray:
    """Return the picture, in half of the cases sharpened by unsharp masking, as cameras do."""
    if rng.random() < 0.5:
        return coded
    soft = gaussian(coded, sigma := rng.uniform(0.7, 1.6))
    if options.grain_share and rng.random() < options.grain_share:
        soft = np.asarray(cv2.GaussianBlur(coded, (9, 1) if rng.random() < 0.6 else (1, 9), sigma))
    return np.asarray(np.clip(coded + rng.uniform(*options.sharpening) * (coded - soft), 0, 1))


def compress(rng: np.random.Generator, image: AnyArray) -> AnyArray:
    """Return a picture (uint8 RGB) after JPEG at a quality between poor and good."""
    quality = int(rng.integers(35, 98))
    _, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    decoded = cv2.imdecode(data, cv2.IMREAD_COLOR)
    if decoded is None:
        raise ValueError(f"OpenCV cannot decode its own JPEG of shape {image.shape}")
    return np.asarray(decoded[..., ::-1])


def photograph(rng: np.random.Generator, linear: AnyArray, options: SensorOptions | None = None) -> AnyArray:
    """Return linear radiance (H, W, 3), 1 about white before exposure, as an 8-bit photograph, uint8 RGB."""
    options = options or SensorOptions()
    signal = soften(rng, expose(rng, linear.astype(np.float32)), options)
    mosaic = rng.random() < 0.4
    signal = add_noise(rng, signal, options)
    if mosaic:
        unbalanced = options.unbalanced_share > 0 and rng.random() < options.unbalanced_share
        signal = demosaic_unbalanced(rng, signal) if unbalanced else demosaic(signal)
    if rng.random() < 0.3:  # denoised by the camera
        signal = gaussian(signal, rng.uniform(0.4, 0.9))
    if rng.random() < 0.2:
        signal = np.clip(signal * blotches(rng, signal.shape), 0, 1)
    coded = np.asarray(tone(rng, signal), np.float32)
    if options.grain_share and rng.random() < options.grain_share:
        noise = gaussian(rng.standard_normal(coded.shape[:2], dtype=np.float32), rng.uniform(0.6, 1.6))
        coded += np.float32(log_uniform(rng, (2e-3, 1.5e-2)) / noise.std()) * noise[..., None]
    coded = sharpen(rng, coded, options)
    if rng.random() < 0.1:
        coded = np.repeat(coded.mean(2, keepdims=True), 3, axis=2)
    image = np.asarray(np.clip(coded, 0, 1) * 255 + 0.5).astype(np.uint8)
    return compress(rng, image) if rng.random() < options.jpeg_share else image


def small_camera(softness_px: float) -> SensorOptions:
    """Return a phone's options, in focus: an unbalanced mosaic, halos of sharpening, grain."""
    spread = (softness_px, softness_px)
    return SensorOptions(
        softness_px=spread, defocus_share=0.0, unbalanced_share=0.6, sharpening=(0.2, 2.0), grain_share=0.3
    )


def processed(rng: np.random.Generator, linear: AnyArray) -> tuple[AnyArray, float]:
    """Photograph radiance (H, W, 3) as phones, videos and web sites do: uint8 RGB, or float32 on its scale.

    Also return the radius of the disc that spreads as widely as the camera does, pixels.
    """
    height, width = linear.shape[:2]
    softness = rng.uniform(0.0, 1.2)
    if rng.random() < REDUCED_SHARE:
        return reduced(rng, linear, softness)
    spread = 2 * softness
    if rng.random() < UPSCALED_SHARE:
        factor = rng.uniform(1.15, 2.5)
        size = (round(width / factor), round(height / factor))
        small = cv2.resize(linear, size, interpolation=cv2.INTER_AREA)
        image = photograph(rng, np.asarray(small), small_camera(softness))
        how = cv2.INTER_CUBIC if rng.random() < 0.6 else cv2.INTER_LINEAR
        image = np.asarray(cv2.resize(image, (width, height), interpolation=how))
        spread = float(np.hypot(spread * factor, UPSCALED * np.sqrt(factor**2 - 1)))
    else:
        image = photograph(rng, linear, small_camera(softness))
    if rng.random() < DENOISED_SHARE:
        image = np.asarray(cv2.bilateralFilter(image, 5, rng.uniform(8, 40), rng.uniform(1, 3)))
    if rng.random() < TWICE_SHARE:
        image = compress(rng, image)
    return image, spread


def reduced(rng: np.random.Generator, linear: AnyArray, softness: float) -> tuple[AnyArray, float]:
    """Do the same of a picture twice as large, or much larger, which leaves hardly any noise; reduce it."""
    height, width = linear.shape[:2]
    if rng.random() < 0.5:
        large = cv2.resize(linear, (2 * width, 2 * height), interpolation=cv2.INTER_CUBIC)
        image = photograph(rng, np.maximum(np.asarray(large), 0), small_camera(softness))
        small = cv2.resize(image.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
        return np.asarray(small), softness
    softness /= 2
    lens = SensorOptions(softness_px=(softness, softness), defocus_share=0.0)
    signal = soften(rng, expose(rng, linear.astype(np.float32)), lens)
    coded = np.clip(tone(rng, np.clip(signal, 0, 1)), 0, 1)
    noise = rng.standard_normal(coded.shape, dtype=np.float32)
    noise *= np.float32(np.exp(rng.uniform(np.log(1e-4), np.log(2e-3))))
    return np.asarray((np.clip(coded + noise, 0, 1) * 255).astype(np.float32)), 2 * softness


def point_spread(rng: np.random.Generator, radius_px: float, kind: str | None = None) -> AnyArray:
    """Return a point spread (n, n) of sum one, of a kind or any, as wide as the disc of a radius."""
    kind = kind or str(rng.choice(SPREADS, p=SPREAD_SHARES))
    squeeze = rng.uniform(LEAST_AXIS, 1) if rng.random() < ELLIPTIC_SHARE else 1.0
    angle, blades = rng.uniform(0, np.pi), int(rng.integers(5, 10))
    reach = int(np.ceil((2.5 if kind == "gaussian" else 1.5) * radius_px / squeeze**0.5)) + 1
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(np.float32)
    x, y = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    x, y = x * squeeze**0.5, y / squeeze**0.5
    distance = np.hypot(x, y)
    match kind:
        case "gaussian":
            kernel = np.exp(-2 * (distance / radius_px) ** 2)
        case "blades":
            sector = 2 * np.pi / blades
            along = np.remainder(np.arctan2(y, x), sector) - sector / 2
            # the apothem of the regular polygon with the disc's second moment
            apothem = radius_px * np.sqrt(6 / (2 + 1 / np.cos(np.pi / blades) ** 2) / 2)
            kernel = np.clip(apothem - distance * np.cos(along) + 0.5, 0, 1)
        case "ring":
            bright, hole = rng.uniform(0.3, 1), rng.uniform(0.4, 0.8)
            inside = np.clip(radius_px + 0.5 - distance, 0, 1)
            kernel = inside - bright * np.clip(hole * radius_px + 0.5 - distance, 0, 1)
        case _:
            kernel = np.clip(radius_px + 0.5 - distance, 0, 1)
    kernel = np.maximum(kernel, 0)
    return np.asarray(kernel / kernel.sum(), np.float32)


def defocused(rng: np.random.Generator, linear: AnyArray, radius_px: float) -> AnyArray:
    """Return radiance (H, W, C), with its alpha if it has one, out of focus by this radius."""
    if radius_px < 0.3:
        return linear
    kernel, image = point_spread(rng, radius_px), linear.astype(np.float32)
    border = cv2.BORDER_REFLECT if image.shape[2] == 3 else cv2.BORDER_CONSTANT
    return np.asarray(cv2.filter2D(image, -1, kernel, borderType=border))
