"""Call a function of the library with odd arguments, drawn from a seed, in a folder of `fuzz`'s inputs.

    python -m tools.robustness.odd_arguments SEED

An error that says what was wrong, one of blur2view's or a TypeError or ValueError that one of its modules
raises, is one line on stderr; any other ends in a traceback, which is what `fuzz` looks for.
"""

import io
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

import blur2view
from blur2view.arrays import AnyArray, Array
from blur2view.cli.terminal import printable
from blur2view.errors import Blur2ViewError
from blur2view.records.record import Record
from blur2view.smears.grid import stored_smears
from tools.robustness.odd_inputs import mutated

Rng = np.random.Generator
NUMBERS = (
    0,
    1,
    2,
    3,
    7,
    10**9,
    10**30,
    -1,
    -7,
    0.5,
    1e-300,
    1e300,
    float("nan"),
    float("inf"),
    float("-inf"),
)
PATHS = (
    "",
    "nowhere",
    "nowhere/x",
    "/",
    "/dev/null",
    "/dev/zero",
    "frames",
    "good.jpg",
    "a\0b",
    "\udcff",
    "x" * 300,
)
# what calls may make, or add to; the last is the odd name of a folder that is asked for
WRITTEN = "made", "copies", "a.npz", "notes.jsonl", "nowhere", "frames", "\udcff"
CAMERAS = (
    "",
    "PINHOLE",
    "PINHOLE 240 180 nan 1 1 1",
    "PINHOLE 0 0 1 1 1 1",
    "SIMPLE_RADIAL 240 180 1e300 0 0 9e99",
)
TYPES = ("uint8", "uint16", "float32", "float64", ">u2", ">f4", "float16", "int64", "bool", "complex64")
SIZES = (0, 1, 2, 15, 16, 17, 40, 97, 240)


def number(rng: Rng) -> float:
    """Return an odd number."""
    return NUMBERS[int(rng.integers(len(NUMBERS)))]


def path(rng: Rng, good: str = "good.jpg") -> str:
    """Return an odd path, or in a third of the cases a good one."""
    return good if rng.random() < 1 / 3 else PATHS[int(rng.integers(len(PATHS)))]


def picture(rng: Rng) -> AnyArray:
    """Return an array that may be a photograph."""
    shape = [int(rng.choice(SIZES)) for _ in range(2)] + [[], [3], [3], [4], [1], [2]][int(rng.integers(6))]
    values = (
        rng.uniform(0, 1, shape)
        if rng.random() < 0.7
        else np.full(shape, rng.choice([0, 0.5, 1, np.nan, np.inf]))
    )
    with np.errstate(all="ignore"):
        kind = str(rng.choice(TYPES))
        return (values * (1 if "f" in kind else 255)).astype(kind)


def points(rng: Rng, columns: int = 2) -> Array:
    """Return an array that may be points (N, ``columns``)."""
    shape = int(rng.choice([0, 1, 6, 7, 8, 30])), columns if rng.random() < 0.8 else int(rng.integers(5))
    values = rng.normal(0, 100, shape) * rng.choice([0, 1e-300, 1, 1, 1, 1e300])
    values[rng.random(shape) < rng.choice([0, 0, 0.1, 1])] = rng.choice([np.nan, np.inf, 0, 1e12])
    return np.asarray(values)


def estimated(rng: Rng) -> blur2view.Estimate:
    """Return the estimate of a photograph of random texture, as small as one may be or larger."""
    shape = int(rng.choice([16, 40, 97, 240])), int(rng.choice([16, 40, 97, 240])), 3
    return blur2view.estimate(rng.uniform(0, 1, shape), rng=0)


def matched(rng: Rng) -> object:
    """Estimate the geometry of odd matches."""
    first = points(rng)
    second = first + rng.normal(0, 5, first.shape) if rng.random() < 0.7 else points(rng)
    matches = blur2view.SmearMatches.from_points(first, second)
    camera = blur2view.Camera.from_focal(300, (240, 180)) if rng.random() < 0.5 else None
    return blur2view.estimate_two_view(matches, rng=int(rng.integers(9)), camera=camera)


def camera(rng: Rng) -> object:
    """Make a camera of odd numbers, or estimate with it."""
    if rng.random() < 0.3:
        return blur2view.Camera.from_string(CAMERAS[int(rng.integers(len(CAMERAS)))])
    size = (240, 180) if rng.random() < 0.5 else (number(rng), number(rng))
    made = blur2view.Camera.from_focal(number(rng), size)  # type: ignore[arg-type]
    return blur2view.estimate("good.jpg", camera=made)


def stored(rng: Rng) -> object:
    """Load smears, or a record, of which bytes were changed."""
    if rng.random() < 0.5:
        found = Record.from_json(mutated(Record(name="a", blur="sharp").to_json().encode(), rng))
        return found.to_json()
    file = io.BytesIO()
    np.savez_compressed(file, **stored_smears(estimated(rng).grid))  # type: ignore[arg-type]  # as in cli
    Path("a.npz").write_bytes(mutated(file.getvalue(), rng))
    return blur2view.load_smears(path(rng, "a.npz"))


def frames(rng: Rng) -> object:
    """Estimate frames with odd times, or of an odd video."""
    if rng.random() < 0.3:
        return list(blur2view.estimate_frames(path(rng, "clip.mp4")))
    some = [
        rng.uniform(0, 1, (40, 60, 3)) if rng.random() < 0.9 else picture(rng)
        for _ in range(int(rng.integers(4)))
    ]
    times = None if rng.random() < 0.5 else [number(rng) for _ in range(int(rng.integers(5)))]
    return list(blur2view.estimate_frames(some, timestamps_s=times))


def video(rng: Rng) -> object:
    """Read an odd stretch of a video, or the times of odd photographs."""
    if rng.random() < 0.3:
        return blur2view.timestamps_of([path(rng) for _ in range(3)])
    read = blur2view.read_video(path(rng, "clip.mp4"), every=number(rng), first=number(rng), last=number(rng))  # type: ignore[arg-type]
    return [frame.shape for frame, _ in zip(read, range(9), strict=False)]


def segmented(rng: Rng) -> object:
    """Segment, draw, or take kernels and maps, of an estimate and a picture that may not fit."""
    result = estimated(rng)
    image = rng.uniform(0, 1, (*result.grid.shape, 3)) if rng.random() < 0.4 else picture(rng)
    match int(rng.integers(4)):
        case 0:
            return blur2view.segment(result, image, rng=int(rng.integers(9)), threshold=number(rng))
        case 1:
            return blur2view.draw_overlay(image, result)
        case 2:
            return blur2view.blur_of(result.grid, image)
    return blur2view.blur_kernels(result.grid, result.blur), blur2view.blur_map(result.grid)


def views(rng: Rng) -> object:
    """Write the views of photographs of odd names to an odd database."""
    names = [str(rng.choice(["a.jpg", "a b.jpg", "", "a\n.jpg", "a#open", "\ud800"])) for _ in range(2)]
    made = [blur2view.views_of(name, estimated(rng)) for name in names]
    blur2view.write_database(path(rng, "made.db"), made)
    return None


def models(rng: Rng) -> object:
    """Recover frames, or place views, of odd paths, names and numbers."""
    names: list[str] | None = None
    if rng.random() < 0.6:
        names = [f"f_{k:03d}.png" for k in rng.integers(0, 11, int(rng.integers(8)))] + [path(rng)]
    if rng.random() < 0.5:
        return blur2view.place_views(path(rng, "linked.db"), path(rng, "model"), names, number(rng))
    notes = path(rng, "notes.jsonl") if rng.random() < 0.3 else None
    keep, database = bool(rng.random() < 0.3), path(rng, "scene/database.db") if rng.random() < 0.4 else None
    given = path(rng, "scene/work/model"), path(rng, "all")
    return blur2view.recover_frames(*given, names, database=database, keep_keypoints=keep, notes=notes)


def scene(rng: Rng) -> object:
    """Make a scene by odd options."""
    words = {
        "frames": number(rng),
        "exposure_s": number(rng),
        "camera": CAMERAS[int(rng.integers(len(CAMERAS)))],
    }
    chosen = {key: value for key, value in words.items() if rng.random() < 0.5}
    options = blur2view.ReconstructionOptions(masks=False, **chosen)  # type: ignore[arg-type]
    return blur2view.reconstruct(path(rng, "walk"), path(rng, "made"), options, jobs=1)


def stretched(rng: Rng) -> object:
    """Write stretched copies of odd photographs."""
    names = [path(rng, "f_000.png") for _ in range(2)] if rng.random() < 0.5 else None
    return blur2view.write_stretched(path(rng, "walk"), path(rng, "copies"), names)


def estimate(rng: Rng) -> object:
    """Estimate an array, or an odd path, with odd options."""
    options: dict[str, Callable[[], object]] = {
        "select": lambda: blur2view.SelectOptions(beta=number(rng), max_matches=number(rng)),  # type: ignore[arg-type]
        "options": lambda: blur2view.EstimatorOptions(max_error_px=number(rng)),
        "network": lambda: path(rng, "smear.onnx"),
        "shutter": lambda: blur2view.RollingShutter(readout_s=number(rng), exposure_s=number(rng)),
    }
    given = {key: make() for key, make in options.items() if rng.random() < 0.2}
    image = picture(rng) if rng.random() < 0.7 else path(rng)
    return blur2view.estimate(image, rng=0, **given)  # type: ignore[arg-type]


CALLS: tuple[Callable[[Rng], object], ...] = (
    estimate, matched, camera, stored, frames, video, segmented, views, models, scene, stretched,
)  # fmt: skip


def is_said(error: Exception) -> bool:
    """Return whether an error says what was wrong: blur2view raised it, and no library below it."""
    if isinstance(error, Blur2ViewError) or "null byte" in str(error):  # in a path
        return True
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    raised = "" if trace is None else trace.tb_frame.f_globals.get("__name__", "")
    return isinstance(error, TypeError | ValueError) and raised.startswith("blur2view")


def main(seed: int) -> int:
    """Make the call; return the exit code."""
    import pycolmap  # after blur2view, which says why

    pycolmap.logging.minloglevel = pycolmap.logging.Level.ERROR.value
    rng = np.random.default_rng(seed)
    call = CALLS[int(rng.integers(len(CALLS)))]
    try:
        call(rng)
    except Exception as error:
        if not is_said(error):
            raise
        print(f"blur2view: {printable(' '.join(str(error).split()))}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
