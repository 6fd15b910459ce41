"""Make the fast network: the U-Net's convolutions in 8-bit integers, stem and head as they are.

``python -m tools.training.quantize models/smear.onnx models/smear_fast.onnx`` calibrates the ranges of
activations on rendered photographs (per channel for weights, QDQ format) and keeps the metadata.
``tools.evaluation.evaluate --model`` tells what it costs.
"""

from __future__ import annotations

import argparse
import hashlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnxruntime.quantization import (
    CalibrationDataReader,
    CalibrationMethod,
    QuantFormat,
    QuantType,
    quantize_static,
)
from onnxruntime.quantization.shape_inference import quant_pre_process

from tools.rendering.render import RenderOptions, render
from tools.rendering.sensor import photograph

SCENES = 24
"""Rendered photographs, seeds 0 on, whose activations set the ranges."""
PERCENTILE = 99.99
"""Share of the activations within the range; what is beyond saturates."""
EXACT = ("/stem", "/head")
"""Parts of the graph that stay in floating point."""


class Photographs(CalibrationDataReader):  # type: ignore[misc]  # onnxruntime has no types
    """The calibration's pictures, (1, 3, 240, 320) float32 each."""

    def __init__(self, scenes: int) -> None:
        self.inputs = calibration_images(scenes)

    def get_next(self) -> dict[str, NDArray[np.float32]] | None:
        """Give the next input, None after the last."""
        image = next(self.inputs, None)
        return None if image is None else {"image": image}


def calibration_images(scenes: int) -> Iterator[NDArray[np.float32]]:
    """Yield rendered photographs as the network takes them."""
    for seed in range(scenes):
        linear = render(seed, RenderOptions()).linear
        image = photograph(np.random.default_rng(seed), linear).astype(np.float32) / 255
        yield np.ascontiguousarray(image.transpose(2, 0, 1)[None])


def quantized_nodes(graph: onnx.GraphProto) -> list[str]:
    """Name the convolutions that are computed in integers."""
    return [n.name for n in graph.node if n.op_type == "Conv" and not any(part in n.name for part in EXACT)]


def quantize(source: Path, target: Path, scenes: int = SCENES) -> None:
    """Write `target`, when complete, with the metadata of `source` and a model id of its own."""
    with tempfile.TemporaryDirectory() as folder:
        prepared, integer = Path(folder) / "prepared.onnx", Path(folder) / "integer.onnx"
        quant_pre_process(str(source), str(prepared), skip_symbolic_shape=True)
        quantize_static(
            str(prepared),
            str(integer),
            Photographs(scenes),
            quant_format=QuantFormat.QDQ,
            per_channel=True,
            reduce_range=True,  # 7-bit weights: processors without VNNI saturate sums of 8-bit products
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            nodes_to_quantize=quantized_nodes(onnx.load(prepared).graph),
            calibrate_method=CalibrationMethod.Percentile,
            extra_options={"CalibPercentile": PERCENTILE},
        )
        graph = onnx.load(integer)
    save_described(graph, onnx.load(source), target)


def save_described(graph: onnx.ModelProto, source: onnx.ModelProto, target: Path) -> None:
    """Give a model the metadata of its source, but for its id, and save it."""
    del graph.metadata_props[:]
    digest = hashlib.sha256(graph.SerializeToString()).hexdigest()
    known = {entry.key: entry.value for entry in source.metadata_props}
    onnx.helper.set_model_props(graph, {**known, "model_id": f"{known['model_id']}-int8-{digest[:6]}"})
    onnx.checker.check_model(graph)
    temporary = target.with_suffix(".tmp.onnx")
    onnx.save(graph, temporary)
    temporary.replace(target)


def main() -> None:
    """Command line."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("source", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--scenes", type=int, default=SCENES, help="photographs (default: %(default)s)")
    arguments = parser.parse_args()
    quantize(arguments.source, arguments.target, arguments.scenes)
    print(f"{arguments.target}: {arguments.target.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
