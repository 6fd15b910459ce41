"""blur2view: one motion-blurred photograph in, the two-view geometry of the camera's motion out.

Conventions, used everywhere
----------------------------
- Image points are (x, y), float64, in pixels; (0, 0) is the centre of the top-left pixel (OpenCV).
- A smear is the full displacement d = end - start in pixels of a scene point during the exposure,
  defined up to sign, at the mid-exposure pixel p. Its ends are p - d/2 and p + d/2; their order in
  time is unknown. (The paper's s is d/2.)
- Double angle: d -> |d| (cos 2phi, sin 2phi), the same for d and -d. Fields are resized, averaged,
  blended and tiled in double angle only, and decoded last.
- F: ``points2^T F points1 = 0`` with 1 = shutter open, 2 = shutter close, ||F|| = 1. Which end of time
  is which stays open for the whole image: F and its transpose are one answer.
- Poses are ``cam2_from_cam1``: X2 = R X1 + t, t of unit length, or zero where its direction is unknown
  (``TRANSLATION_RULE`` of two_view/constants.py); a pose and its inverse are one answer (with a rolling
  shutter: the two of ``reversed()``).
- Thresholds named ``max_error_px`` are pixels; residuals and SErrMin are squared pixels.
- Decoded images are float32 (H, W, 3), RGB, sRGB-coded, in [0, 1].

First calls
-----------
- ``result = estimate("a.jpg")``: smears, matches and ``result.geometry``, with F or None, the configuration
  and its reason; with ``camera=Camera.from_focal(focal, (width, height))`` E and the pose, of which
  ``result.angular_velocity(exposure_s)`` has mean and covariance.
- ``for result in estimate_frames("a.mp4", camera=camera)``: a video's frames, each in the right direction
  of time. Others: a loop over ``estimate`` with one ``network = SmearNetwork()``, which threads may share.
- ``segment(result, image)``; ``write_database("new.db", [views_of("a.jpg", result)])``, as `to-colmap`;
  ``result.geometry.to_pycolmap()``.
- ``for record in triage("photographs")``: what blurs each and by how much, as `triage`.
- ``reconstruct("a.mp4", "scene")``: a scene of a video, as `reconstruct`;
  ``recover_frames("model", "frames").model``: COLMAP's model with the frames that it refused, as `recover`;
  ``place_views("project.db", "model").model``: with both views of its frames, as `place`.
- ``load_smears("out/a.smear.npz")``: the smears that `blur2view estimate -o` has written;
  ``SmearMatches.from_points(points1, points2)``: matches of unknown order from elsewhere.

The method follows "Robust Fundamental Matrix Estimation from Single Image Motion Blur" (Tran, Forssen,
Viksten), called "the paper" in this package.
"""

import sys
import warnings
import zlib  # noqa: F401  or else pycolmap's own comes first, and the first PNG that is written aborts
from importlib import import_module

__version__ = "0.4.0"

with open(f"{__file__}i", encoding="utf-8") as _stub:  # __init__.pyi
    _MODULE_OF = {line.split()[-1]: line.split()[1] for line in _stub if line.startswith("from ")}
"""Public names and where they live, as the stub lists them for type checkers."""
__all__ = ["__version__", *sorted(_MODULE_OF)]

_IMPORTED = list(sys.modules)  # in order
if "pycolmap" in _IMPORTED and not {"cv2", "zlib"} & set(_IMPORTED[: _IMPORTED.index("pycolmap")]):
    warnings.warn(
        "pycolmap was imported before blur2view; its zlib replaces Python's, and the first PNG to be written "
        "may abort or block the process; import blur2view first",
        RuntimeWarning,
        stacklevel=2,
    )


def __getattr__(name: str) -> object:
    """Return a public name, imported when it is first used: `import blur2view` alone loads nothing."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names, and what every module has."""
    return sorted({*(name for name in globals() if name.startswith("__")), *__all__})
