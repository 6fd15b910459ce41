"""A tiny network of the shipped format, and pictures that it turns into a known smear field.

A picture is grey with three fine patterns, columns, rows and squares of one pixel that alternate, whose
strengths tell the smear: the network reads, as means over each cell of 32 px, the double-angle vector
``CODE_RANGE_PX * (columns, rows)`` and sigma, ``SIGMA_RANGE_PX * squares``, and gives the likelihood of that
smear, all of it in focus. Smaller octaves, where the patterns average out, say nothing. So a test that
paints a picture knows what the network will see in it.
"""

from pathlib import Path

import cv2
import numpy as np
import onnx
import onnx.parser
from numpy.typing import NDArray

from blur2view.networks.model_file import SMEAR
from blur2view.networks.spectra import LAGS, SCALES
from blur2view.smears.grid import to_double_angle
from blur2view.smears.likelihood import (
    BINS,
    DIRECTIONS,
    KINDS,
    PER_OCTAVE,
    SHARP,
    SMEARED,
    STILL_PX,
    lengths_px,
)

CODE_RANGE_PX = 64.0
SIGMA_RANGE_PX = 8.0
STRENGTH = 1 / 6  # of a pattern at the end of its range: three of them fill the range of greys
BIN_WIDTH = 0.6 * np.log(2) / PER_OCTAVE  # deviation of a likelihood, of the length, where sigma is 0
MIN_SHARE = 0.01  # strength of the squares, of its range, from which on a cell says something
CHANNELS, SURE = 2, 10.0  # features; logit of the kind of blur, and of the smallest radius
HEIGHT, WIDTH = 240, 320
EPIPOLE = np.array([150.0, 100.0])

METADATA = {
    "blur2view_format": SMEAR.version,
    "stride": "32",
    "multiple_of": "32",
    "model_id": "colour-code",
    "license": "CC0-1.0",
    "training": '{"seed": 0}',
}


def colour_code(
    displacement: NDArray[np.floating], sigma_px: NDArray[np.floating] | float
) -> NDArray[np.float32]:
    """Return the picture, (H, W, 3) float32 RGB, in which the tiny network sees this field."""
    vectors = to_double_angle(displacement) / CODE_RANGE_PX
    height, width = vectors.shape[:2]
    squares = np.clip(
        np.broadcast_to(np.asarray(sigma_px) / SIGMA_RANGE_PX, (height, width)), 2 * MIN_SHARE, 1
    )
    rows, columns = (1 - 2 * (i % 2) for i in np.indices((height, width)))
    code = vectors[..., 0] * columns + vectors[..., 1] * rows + squares * rows * columns
    return np.repeat(0.5 + STRENGTH * code[..., None], 3, -1).astype(np.float32)


def noise(height: int = 64, width: int = 64) -> NDArray[np.float32]:
    """Return a picture, (H, W, 3), that is flat nowhere, so that the network has to read it."""
    return np.random.default_rng(0).random((height, width, 3), np.float32)


def write_picture(path: Path, rgb: NDArray[np.float32]) -> Path:
    """Write a picture as 16-bit PNG, which keeps the colour code to 0.001 px."""
    bgr = np.round(rgb[..., ::-1] * 65535).astype(np.uint16)
    assert cv2.imwrite(str(path), bgr)
    return path


GRAPH = f"""<ir_version: 8, opset_import: ["": 17]>
code (float[1, 1, H, W] grey, float[1, h, w, {DIRECTIONS}, {LAGS}] cepstra, float[1, h, w, {SCALES}] scales,
      float[1, h, w, {DIRECTIONS}, {CHANNELS}] coarser)
  => (float[1, h2, w2, d, b] logits, float[1, h2, w2, b] radii, float[1, h2, w2, k] kinds,
      float[1, h2, w2, d, c] features) {{
  phase0 = Slice(grey, from0, to, axes, steps) phase1 = Slice(grey, from1, to, axes, steps)
  phase2 = Slice(grey, from2, to, axes, steps) phase3 = Slice(grey, from3, to, axes, steps)
  phases = Concat <axis = 1> (phase0, phase1, phase2, phase3)
  own = AveragePool <kernel_shape = [16, 16], strides = [16, 16]> (phases)
  cells = AveragePool <kernel_shape = [1, 1], pads = [0, 0, 0, 0]> (own)
  phases_last = Transpose <perm = [0, 2, 3, 1]> (cells) code = MatMul(phases_last, read)
  vector = Gather <axis = 3> (code, xy) sigma = Gather <axis = 3> (code, last)
  squared = Mul(vector, vector) powers = Concat <axis = 3> (vector, squared)
  relative = MatMul(powers, apart) distance = Add(relative, ends)
  variance = Mul(sigma, sigma) spreads = Add(variance, spread) ratio = Div(distance, spreads)
  coded = Greater(sigma, least) gate = Cast <to = 1> (coded) weight = Mul(gate, scale)
  flat = Mul(ratio, weight) logits = Reshape(flat, bins) likelihood = Softmax <axis = -1> (flat)
  kinds = MatMul(likelihood, kind) radii = MatMul(likelihood, smallest) features = MatMul(logits, none)
}}"""
"""The tiny network, whose constants `colour_code_network` adds."""


def colour_code_network(blur: bool = False, **metadata: str) -> onnx.ModelProto:
    """Return the tiny network; with ``blur`` it averages 3x3 cells, as a trained one looks at neighbours."""
    signs = np.array([[1, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1]])  # by phase and pattern
    length = lengths_px(BINS).astype(float)
    doubled = 2 * np.pi / DIRECTIONS * np.arange(DIRECTIONS)[:, None]
    x, y = (length * (np.arange(BINS) > 0) * f(doubled) for f in (np.cos, np.sin))
    apart = np.stack([-2 * x, -2 * y, np.ones_like(x), np.ones_like(x)])  # |v - e|^2 = (v - 2 e) v + e^2
    spread = np.where(np.arange(BINS), BIN_WIDTH * length, 2 * STILL_PX) ** 2
    kinds = np.full((DIRECTIONS, BINS, len(KINDS)), -SURE)
    kinds[:, :2, SHARP], kinds[:, 2:, SMEARED] = SURE, SURE  # the first up to 2 px
    constants = {
        "read": signs / (4 * STRENGTH) * [CODE_RANGE_PX, CODE_RANGE_PX, SIGMA_RANGE_PX],
        "apart": apart.reshape(4, -1),
        "ends": (x**2 + y**2).ravel(),
        "spread": np.broadcast_to(spread, x.shape).ravel(),
        "scale": np.array([-0.5]),
        "least": np.array([MIN_SHARE * SIGMA_RANGE_PX]),
        "none": np.zeros((BINS, CHANNELS)),
        "smallest": np.tile([SURE, *[0] * (BINS - 1)], (DIRECTIONS * BINS, 1)),
        "kind": kinds.reshape(-1, len(KINDS)),
        "xy": np.array([0, 1]),
        "last": np.array([2]),
        "bins": np.array([0, 0, 0, DIRECTIONS, BINS]),
        **{f"from{k}": np.array(divmod(k, 2)) for k in range(4)},
        "to": np.array([1 << 31, 1 << 31]),
        "axes": np.array([2, 3]),
        "steps": np.array([2, 2]),
    }
    near = GRAPH.replace("[1, 1], pads = [0, 0, 0, 0]", "[3, 3], pads = [1, 1, 1, 1]")
    model = onnx.parser.parse_model(near if blur else GRAPH)
    for name, array in constants.items():
        kind = np.int64 if array.dtype.kind == "i" else np.float32
        model.graph.initializer.append(onnx.numpy_helper.from_array(array.astype(kind), name))
    onnx.helper.set_model_props(model, METADATA | metadata)
    return model


def forward_motion() -> NDArray[np.float64]:
    """Return the smears, (H, W, 2), of a camera moving towards EPIPOLE past a scene of varying depth."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    nearness = 0.16 + 0.06 * np.sin(x / 40) * np.cos(y / 30)
    smears: NDArray[np.float64] = (np.stack([x, y], -1) - EPIPOLE) * nearness[..., None]
    return smears
