"""A tiny network of the shipped format, and pictures that it turns into a known smear field.

The network reads the smear from the colours: with RGB averaged over 4x4 pixels, the double-angle vector
is ``CODE_RANGE_PX * (2 R - 1, 2 G - 1)`` and sigma is ``SIGMA_RANGE_PX * B``. So a test that paints a
picture knows what the network will see in it.
"""

from pathlib import Path

import cv2
import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper

from blur2view.smears.field import to_double_angle

CODE_RANGE_PX = 64.0
SIGMA_RANGE_PX = 8.0
HEIGHT, WIDTH = 240, 320
EPIPOLE = np.array([150.0, 100.0])

METADATA = {
    "blur2view_format": "1",
    "stride": "4",
    "multiple_of": "64",
    "model_id": "colour-code",
    "license": "CC0-1.0",
    "training": '{"seed": 0}',
}


def colour_code(
    displacement: NDArray[np.floating], sigma_px: NDArray[np.floating] | float
) -> NDArray[np.float32]:
    """Return the picture, (H, W, 3) float32 RGB, in which the tiny network sees this field."""
    vectors = to_double_angle(displacement) / CODE_RANGE_PX
    sigma = np.broadcast_to(np.asarray(sigma_px), vectors.shape[:2]) / SIGMA_RANGE_PX
    return np.dstack([(vectors + 1) / 2, sigma]).astype(np.float32)


def write_picture(path: Path, rgb: NDArray[np.float32]) -> Path:
    """Write a picture as 16-bit PNG, which keeps the colour code to 0.001 px."""
    bgr = np.round(rgb[..., ::-1] * 65535).astype(np.uint16)
    assert cv2.imwrite(str(path), bgr)
    return path


def colour_code_network(blur: bool = False, channels: int = 3, **metadata: str) -> onnx.ModelProto:
    """Return the tiny network; with ``blur`` it averages 3x3 cells, zero-padded as a trained one would be.

    A fourth channel, the direction's sigma in radians, is 1 - B.
    """
    code = np.diag([2 * CODE_RANGE_PX, 2 * CODE_RANGE_PX, SIGMA_RANGE_PX])
    scale = np.vstack([code, [0.0, 0.0, -1.0]])[:channels].astype(np.float32)
    size = 3 if blur else 1
    kernel = np.repeat(np.repeat(scale[..., None, None], size, 2), size, 3) / size**2
    bias = np.array([-CODE_RANGE_PX, -CODE_RANGE_PX, 0, 1], np.float32)[:channels]
    nodes = [
        helper.make_node("AveragePool", ["image"], ["cells"], kernel_shape=[4, 4], strides=[4, 4]),
        helper.make_node("Conv", ["cells", "kernel", "bias"], ["smear"], pads=[size // 2] * 4),
    ]
    graph = helper.make_graph(
        nodes,
        "colour_code",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, ["n", 3, "h", "w"])],
        [helper.make_tensor_value_info("smear", TensorProto.FLOAT, ["n", channels, "h4", "w4"])],
        [onnx.numpy_helper.from_array(kernel, "kernel"), onnx.numpy_helper.from_array(bias, "bias")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, METADATA | metadata)
    return model


def forward_motion() -> NDArray[np.float64]:
    """Return the smears, (H, W, 2), of a camera moving towards EPIPOLE past a scene of varying depth."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    nearness = 0.16 + 0.06 * np.sin(x / 40) * np.cos(y / 30)
    smears: NDArray[np.float64] = (np.stack([x, y], -1) - EPIPOLE) * nearness[..., None]
    return smears
