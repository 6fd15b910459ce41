"""From radiance to a coded photograph: lens, exposure, mosaic, noise, tone, sharpening, compression."""

import cv2
import numpy as np

from blur2view.arrays import AnyArray

READ_NOISE, SHOT_NOISE = (3e-4, 6e-3), (1e-5, 1e-3)
"""Deviation in the dark, and variance per unit of signal; log-uniform."""
DEFOCUS_SHARE, JPEG_SHARE = 0.14, 0.75
"""Shares of pictures out of focus by up to 6 px (not of phones), and of JPEGs."""
UNBALANCED_SHARE, GRAIN_SHARE = 0.6, 0.3
"""Shares of a phone's pictures: clipped before the white balance; with grain, sharpened along one axis."""
SPREAD_SHARES = {"disc": 0.45, "blades": 0.25, "gaussian": 0.18, "ring": 0.12}
"""Point spreads of lenses out of focus, and how often each is drawn."""
ELLIPTIC_SHARE, MIN_AXIS = 0.3, 0.75
"""Share of point spreads that are squeezed, as off a lens's axis, and the shortest axis over the longest."""
UPSCALED = 0.8
"""Radius of the disc that spreads as widely as pixels that were far larger, over their side."""
UPSCALED_SHARE, DENOISED_SHARE, TWICE_SHARE, REDUCED_SHARE = 0.12, 0.12, 0.15, 0.25
"""Shares of pictures that were scaled up, smoothed with edges kept, compressed twice, photographed larger."""


def log_uniform(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    """Return a number between two positive bounds, uniform in the logarithm."""
    return float(np.exp(rng.uniform(np.log(bounds[0]), np.log(bounds[1]))))


def gaussian(image: AnyArray, sigma_px: float) -> AnyArray:
    """Return the picture blurred by a Gaussian."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px))


def expose(rng: np.random.Generator, linear: AnyArray, softness_px: float | None) -> AnyArray:
    """Return radiance after gain, white balance and a lens, its mean between dim and overexposed.

    The lens has a Gaussian point spread of this deviation; without one it is drawn, and some are defocused.
    """
    level = float(np.exp(rng.normal(np.log(0.25), 0.6)))
    gain = level / max(float(linear.mean()), 1e-3)
    signal = linear.astype(np.float32) * (gain * rng.uniform(0.85, 1.18, 3)).astype(np.float32)
    if rng.random() < DEFOCUS_SHARE and softness_px is None:
        radius = log_uniform(rng, (0.8, 6.0))
        reach = int(np.ceil(radius)) + 1
        disc = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1])
        disc = np.clip(radius + 0.5 - disc, 0, 1).astype(np.float32)
        signal = np.asarray(cv2.filter2D(signal, -1, disc / disc.sum(), borderType=cv2.BORDER_REFLECT))
    drawn = rng.uniform(0.0, 1.4)
    sigma = drawn if softness_px is None else softness_px
    return gaussian(signal, sigma) if sigma > 0.2 else signal


def add_noise(
    rng: np.random.Generator,
    signal: AnyArray,
    read: tuple[float, float] = READ_NOISE,
    shot: tuple[float, float] = SHOT_NOISE,
) -> AnyArray:
    """Return linear light with read and shot noise drawn between bounds, clipped at black and white."""
    dark, per_unit = log_uniform(rng, read), log_uniform(rng, shot)
    deviation = np.sqrt(np.maximum(signal, 0) * np.float32(per_unit) + np.float32(dark**2))
    noise = rng.standard_normal(signal.shape, dtype=np.float32)
    return np.asarray(np.clip(signal + deviation * noise, 0, 1))


def demosaic(rng: np.random.Generator, signal: AnyArray, unbalanced: bool) -> AnyArray:
    """Return RGB (H, W, 3) in [0, 1], sampled as a Bayer mosaic and interpolated.

    ``unbalanced``: the sensor sees less red and blue than green, is clipped first and balanced last.
    """
    balance, code = np.ones(3, np.float32), cv2.COLOR_BayerBG2BGR  # RGGB by its second row and column
    if unbalanced:
        balance = np.array([rng.uniform(1.2, 2.4), 1.0, rng.uniform(1.2, 2.4)], np.float32)
        signal = np.clip(signal * np.float32(rng.uniform(1.0, 1.6)) / balance, 0, 1)
        code = cv2.COLOR_BayerBG2BGR_EA if rng.random() < 0.4 else code
    mosaic = signal[..., 1].copy()
    mosaic[0::2, 0::2] = signal[0::2, 0::2, 0]
    mosaic[1::2, 1::2] = signal[1::2, 1::2, 2]
    rgb = cv2.cvtColor((mosaic * 65535 + 0.5).astype(np.uint16), code)[..., ::-1]
    return np.clip(rgb.astype(np.float32) / 65535 * balance, 0, 1)


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


def sharpen(rng: np.random.Generator, coded: AnyArray, is_phone: bool) -> AnyArray:
    """Return the picture, in half of the cases sharpened by unsharp masking, as cameras do."""
    if rng.random() < 0.5:
        return coded
    soft = gaussian(coded, sigma := rng.uniform(0.7, 1.6))
    if is_phone and rng.random() < GRAIN_SHARE:
        soft = np.asarray(cv2.GaussianBlur(coded, (9, 1) if rng.random() < 0.6 else (1, 9), sigma))
    return np.asarray(np.clip(coded + rng.uniform(0.2, 2.0 if is_phone else 1.2) * (coded - soft), 0, 1))


def compress(rng: np.random.Generator, image: AnyArray) -> AnyArray:
    """Return a picture (uint8 RGB) after JPEG at a quality between poor and good."""
    quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(35, 98))]
    data = cv2.imencode(".jpg", image[..., ::-1], quality)[1]
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))[..., ::-1]


def photograph(rng: np.random.Generator, linear: AnyArray, phone_px: float | None = None) -> AnyArray:
    """Photograph linear radiance (H, W, 3), about 1 at white before exposure: uint8 RGB.

    With ``phone_px``, the deviation of its lens's point spread, the camera is a phone, in focus: its mosaic
    may clip before the white balance, sharpening leaves halos, grain is added. Without, it is any camera.
    """
    signal = expose(rng, linear, phone_px)
    mosaic, is_phone = rng.random() < 0.4, phone_px is not None
    signal = add_noise(rng, signal)
    if mosaic:
        signal = demosaic(rng, signal, unbalanced=is_phone and rng.random() < UNBALANCED_SHARE)
    if rng.random() < 0.3:  # denoised by the camera
        signal = gaussian(signal, rng.uniform(0.4, 0.9))
    if rng.random() < 0.2:
        signal = np.clip(signal * blotches(rng, signal.shape), 0, 1)
    coded = np.asarray(tone(rng, signal), np.float32)
    if is_phone and rng.random() < GRAIN_SHARE:
        noise = gaussian(rng.standard_normal(coded.shape[:2], dtype=np.float32), rng.uniform(0.6, 1.6))
        coded += np.float32(log_uniform(rng, (2e-3, 1.5e-2)) / noise.std()) * noise[..., None]
    coded = sharpen(rng, coded, is_phone)
    if rng.random() < 0.1:
        coded = np.repeat(coded.mean(2, keepdims=True), 3, axis=2)
    image = np.asarray(np.clip(coded, 0, 1) * 255 + 0.5).astype(np.uint8)
    return compress(rng, image) if rng.random() < JPEG_SHARE else image


def sharp_photograph(rng: np.random.Generator, linear: AnyArray, like: AnyArray) -> AnyArray:
    """Photograph radiance (H, W, 3) as a good camera does, exposed as for the radiance `like`: uint8 RGB.

    `rng` draws the noise; tone curve and compression are always the same.
    """
    signal = linear * np.float32(0.3 / max(float(like.mean()), 1e-3))
    noisy = signal + 0.003 * rng.standard_normal(signal.shape, dtype=np.float32)
    coded = tone(np.random.default_rng(2), np.clip(noisy, 0, 1).astype(np.float32))
    return compress(np.random.default_rng(1), (np.clip(coded, 0, 1) * 255 + 0.5).astype(np.uint8))


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
        image = photograph(rng, np.asarray(cv2.resize(linear, size, interpolation=cv2.INTER_AREA)), softness)
        how = cv2.INTER_CUBIC if rng.random() < 0.6 else cv2.INTER_LINEAR
        image = np.asarray(cv2.resize(image, (width, height), interpolation=how))
        spread = float(np.hypot(spread * factor, UPSCALED * np.sqrt(factor**2 - 1)))
    else:
        image = photograph(rng, linear, softness)
    if rng.random() < DENOISED_SHARE:
        image = np.asarray(cv2.bilateralFilter(image, 5, rng.uniform(8, 40), rng.uniform(1, 3)))
    if rng.random() < TWICE_SHARE:
        image = compress(rng, image)
    return image, spread


def reduced(rng: np.random.Generator, linear: AnyArray, softness: float) -> tuple[AnyArray, float]:
    """Photograph the same twice as large, or much larger, which leaves hardly any noise, and reduce it."""
    height, width = linear.shape[:2]
    if rng.random() < 0.5:
        large = cv2.resize(linear, (2 * width, 2 * height), interpolation=cv2.INTER_CUBIC)
        image = photograph(rng, np.maximum(np.asarray(large), 0), softness).astype(np.float32)
        return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)), softness
    signal = expose(rng, linear, softness / 2)
    coded = np.clip(tone(rng, np.clip(signal, 0, 1)), 0, 1)
    noise = rng.standard_normal(coded.shape, dtype=np.float32)
    noise *= np.float32(log_uniform(rng, (1e-4, 2e-3)))
    return np.asarray((np.clip(coded + noise, 0, 1) * 255).astype(np.float32)), softness


def point_spread(rng: np.random.Generator, radius_px: float) -> AnyArray:
    """Draw a point spread (n, n), of sum one, as wide as the disc of a radius."""
    kind = str(rng.choice(list(SPREAD_SHARES), p=list(SPREAD_SHARES.values())))
    squeeze = rng.uniform(MIN_AXIS, 1) if rng.random() < ELLIPTIC_SHARE else 1.0
    angle, blades = rng.uniform(0, np.pi), int(rng.integers(5, 10))
    reach = int(np.ceil((2.5 if kind == "gaussian" else 1.5) * radius_px / squeeze**0.5)) + 1
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(np.float32)
    x, y = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    x, y = x * squeeze**0.5, y / squeeze**0.5
    distance = np.hypot(x, y)
    disc = np.clip(radius_px + 0.5 - distance, 0, 1)
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
            kernel = np.maximum(disc - bright * np.clip(hole * radius_px + 0.5 - distance, 0, 1), 0)
        case _:
            kernel = disc
    return np.asarray(kernel / kernel.sum(), np.float32)


def defocused(rng: np.random.Generator, linear: AnyArray, radius_px: float) -> AnyArray:
    """Return radiance (H, W, C), with its alpha if it has one, out of focus by this radius."""
    if radius_px < 0.3:
        return linear
    kernel, image = point_spread(rng, radius_px), linear.astype(np.float32)
    border = cv2.BORDER_REFLECT if image.shape[2] == 3 else cv2.BORDER_CONSTANT
    return np.asarray(cv2.filter2D(image, -1, kernel, borderType=border))
