"""From radiance to a coded photograph: exposure, optics, mosaic, noise, tone, sharpening, compression."""

from dataclasses import dataclass

import cv2
import numpy as np

from blur2view.arrays import AnyArray


@dataclass(frozen=True, kw_only=True)
class SensorOptions:
    """Which effects may occur; the defaults are those of training.

    ``softness_px`` is the range of the standard deviation of the optical point spread, ``read_noise`` that of
    the noise in the dark (full scale 1, log-uniform), ``shot_noise`` of its variance per unit signal
    (log-uniform), ``sharpening`` of the strength of unsharp masking. Shares of images are JPEG-compressed,
    out of focus by a disc of up to 6 px radius, taken by an unbalanced mosaic (clipped and interpolated
    before the white balance), and grainy: grey noise a few pixels wide, and sharpened along one axis only, as
    small sensors are read, and videos.
    """

    softness_px: tuple[float, float] = (0.0, 1.4)
    read_noise: tuple[float, float] = (3e-4, 6e-3)
    shot_noise: tuple[float, float] = (1e-5, 1e-3)
    jpeg_share: float = 0.75
    defocus_share: float = 0.14
    unbalanced_share: float = 0.0
    sharpening: tuple[float, float] = (0.2, 1.2)
    grain_share: float = 0.0


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


def add_blotches(rng: np.random.Generator, signal: AnyArray) -> AnyArray:
    """Return the picture with coarse coloured noise, as denoising and video compression leave it."""
    small = rng.standard_normal((-(-signal.shape[0] // 2), -(-signal.shape[1] // 2), 3), dtype=np.float32)
    size = (signal.shape[1], signal.shape[0])
    coarse = np.asarray(cv2.resize(gaussian(small, rng.uniform(0.6, 1.5)), size))
    colour = coarse - coarse.mean(2, keepdims=True)
    return np.asarray(np.clip(signal * (1 + np.float32(rng.uniform(0.01, 0.1)) * colour), 0, 1))


def demosaic(signal: AnyArray, edges: bool = False) -> AnyArray:
    """Return linear RGB (H, W, 3) in [0, 1], sampled as a Bayer mosaic (RGGB) and interpolated back.

    Linearly, or along edges.
    """
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


def tone(rng: np.random.Generator, linear: AnyArray) -> AnyArray:
    """Return sRGB coding or a camera's own curve: another gamma and an S of varying strength."""
    if rng.random() < 0.4:
        curve = 1.055 * np.maximum(linear, 1e-6) ** (1 / 2.4) - 0.055
        return np.where(linear <= 0.0031308, 12.92 * linear, curve)
    coded = np.maximum(linear, 1e-6) ** np.float32(1 / rng.uniform(1.8, 2.6))
    strength = np.float32(rng.uniform(0, 0.8))
    return np.asarray(coded + strength * (coded * coded * (3 - 2 * coded) - coded))


def add_grain(rng: np.random.Generator, coded: AnyArray) -> AnyArray:
    """Return the picture with grey noise that is a few pixels wide."""
    noise = gaussian(rng.standard_normal(coded.shape[:2], dtype=np.float32), rng.uniform(0.6, 1.6))
    strength = log_uniform(rng, (2e-3, 1.5e-2)) / noise.std()
    return np.asarray(coded + np.float32(strength) * noise[..., None])


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
        signal = add_blotches(rng, signal)
    coded = np.asarray(tone(rng, signal), np.float32)
    if options.grain_share and rng.random() < options.grain_share:
        coded = add_grain(rng, coded)
    coded = sharpen(rng, coded, options)
    if rng.random() < 0.1:
        coded = np.repeat(coded.mean(2, keepdims=True), 3, axis=2)
    image = np.asarray(np.clip(coded, 0, 1) * 255 + 0.5).astype(np.uint8)
    return compress(rng, image) if rng.random() < options.jpeg_share else image
