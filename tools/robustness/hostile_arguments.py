"""Options with values that few would give, drawn from a generator of random numbers."""

from tools.robustness.damage import Rng

NUMBERS = (
    "0", "-1", "1e300", "1e-300", "nan", "inf", "-inf", "", "x", "1e", "0x10", "9" * 400, "٣", "1_0", "\0",
    "2147483648", "5e-324", "0.5", " 3 ", "1", "40", "1e-3", "500", "1e9",
)  # fmt: skip
TEXTS = (
    "", "\0", "\n", "\x1b[2J", "ü", "/", ".", "..", "/dev/null", "/proc/x", "a" * 5000, "a/b/c", "good.jpg",
    "good.jpg/x", "--", "-", "~", "%s", "{}", "*", "\udcff", "default", "nowhere.db:1", "good.jpg:1", "exif",
    "out",
)  # fmt: skip
MODELS = (
    "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV",
    "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE",
    "EQUIRECTANGULAR", "", "pinhole", "NONE",
)  # fmt: skip
NUMERIC = (
    "--beta", "--max-error", "--seed", "--max-memory", "--focal", "--exposure", "--readout", "--jobs",
    "--every", "--from", "--to", "--max-failures", "--max-smear", "--best", "--every-best",
)  # fmt: skip
TEXTUAL = (
    "--model", "-o", "--output", "--camera", "--db", "--csv", "--keep", "--extract", "--masks",
)  # fmt: skip


def hostile_arguments(rng: Rng) -> list[str]:
    """Return one to three options with values that few would give."""
    words: list[str] = []
    for _ in range(int(rng.choice([1, 2, 3], p=[0.7, 0.2, 0.1]))):
        if rng.random() < 0.4:
            words += [str(rng.choice(NUMERIC)), NUMBERS[int(rng.integers(len(NUMBERS)))]]
        elif rng.random() < 0.5:
            words += ["--camera", camera_text(rng)]
        else:
            words += [str(rng.choice(TEXTUAL)), TEXTS[int(rng.integers(len(TEXTS)))]]
    flags = (
        "--overwrite", "--json", "--jsonl", "-v", "-q", "--link", "--replace", "--dry-run",
        "--masks=colmap", "--resume", "--recursive", "--sequence", "--no-sequence", "--blurred", "--no-mask",
    )  # fmt: skip
    return words + [flag for flag in flags if rng.random() < 0.04]


def camera_text(rng: Rng) -> str:
    """Return a camera as COLMAP writes it, with numbers that are none of a camera."""
    count = int(rng.integers(0, 14))
    values = [NUMBERS[int(rng.integers(len(NUMBERS)))] if rng.random() < 0.4 else f"{rng.normal(100, 99):.3g}"
              for _ in range(count)]  # fmt: skip
    if rng.random() < 0.6:
        values[:2] = ["120", "90"]
    return " ".join([str(rng.choice(MODELS)), *values])
