"""A tiny network of the shipped format, and pictures whose grey tells it the direction of a smear.

The logits of a cell are those of a smear of ``CODE_LENGTH_PX`` whose direction is 180 degrees times the mean
grey of the cell's own 32x32 pixels. Every smaller octave is sure of the direction, not of the length.
"""

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper

from blur2view.networks.model_file import FORMAT
from blur2view.smears.likelihood import DIRECTIONS, LABEL_SPREAD, PER_OCTAVE, SHORTEST_PX
from tests.support.colour_code import model_of

CODE_LENGTH_PX, BINS, CHANNELS = 8.0, 20, 2

METADATA = {
    "blur2view_format": FORMAT,
    "stride": "32",
    "multiple_of": "32",
    "model_id": "grey-code",
    "license": "CC0-1.0",
    "training": '{"seed": 0}',
}


def grey_code(directions_deg: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the picture (H, W, 3) in which the tiny network sees these directions (H, W), 0 to 180."""
    return np.repeat(directions_deg[..., None] / 180, 3, -1).astype(np.float32)


def grey_code_network(
    cell: int = 32, rows: int = DIRECTIONS, channels: int = CHANNELS, bins: int = BINS, **metadata: str
) -> onnx.ModelProto:
    """Return the tiny network; with other cells, directions, bins or channels it breaks its promise."""
    k, j = np.arange(rows)[:, None], np.arange(bins)
    length = 1 + PER_OCTAVE * np.log2(CODE_LENGTH_PX / SHORTEST_PX)
    scale = 1 / (2 * LABEL_SPREAD**2)
    slope = np.broadcast_to(scale * 2 * DIRECTIONS * k, (rows, bins))  # of -(k - 32 m)^2
    known = -scale * (k**2 + (j - length) ** 2)
    constants = {
        "slope": slope,
        "known": known,
        "ones": np.ones((rows, channels)),
        "axis": np.array([4], np.int64),
        "none": np.zeros(1),
    }
    nodes = [
        helper.make_node("AveragePool", ["grey"], ["means"], kernel_shape=[cell] * 2, strides=[cell] * 2),
        helper.make_node("Transpose", ["means"], ["last"], perm=[0, 2, 3, 1]),
        helper.make_node("Unsqueeze", ["last", "axis"], ["cells"]),
        helper.make_node("Mul", ["cells", "slope"], ["sloped"]),
        helper.make_node("Add", ["sloped", "known"], ["sum"]),
        helper.make_node("ReduceMean", ["coarser"], ["above"], axes=[3, 4], keepdims=1),
        helper.make_node("Mul", ["above", "none"], ["nothing"]),
        helper.make_node("Add", ["sum", "nothing"], ["logits"]),
        helper.make_node("Mul", ["cells", "ones"], ["features"]),
    ]
    return model_of(nodes, constants, CHANNELS, **(METADATA | metadata))
