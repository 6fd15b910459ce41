"""Export the motion segmentation network to the ONNX file that the package ships.

``python -m tools.training.export_motion runs/motion.pt models/motion.onnx`` writes its weights, dynamic in
height and width, with the metadata that :mod:`blur2view.segmentation.network` reads, and checks the file
against torch.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import torch
from numpy.typing import NDArray
from torch import Tensor

from blur2view.errors import Blur2ViewError, ModelError
from blur2view.segmentation.features import CHANNELS
from blur2view.segmentation.network import FORMAT
from tools.rendering.render import RenderOptions, render
from tools.rendering.sensor import photograph
from tools.training.motion_model import MotionUNet
from tools.training.stem import STRIDE
from tools.training.train_motion import load_network

LARGEST_DIFFERENCE = 1e-3
"""Of logits."""

CONVENTION = (
    f"inputs: image (N,3,H,W) float32 RGB, sRGB-coded, 0 to 1; features (N,{CHANNELS},H/stride,W/stride) of "
    "blur2view.motion_features; output: moving (N,1,H/stride,W/stride), logits that a cell moves by itself"
)


def metadata(state: dict[str, Any], digest: str) -> dict[str, str]:
    """Describe the file: format, geometry, licence and how it was trained."""
    return {
        "blur2view_format": FORMAT,
        "model_id": f"motion-{digest[:12]}",
        "stride": str(STRIDE),
        "multiple_of": str(MotionUNet.multiple_of),
        "convention": CONVENTION,
        "license": "Apache-2.0",
        "training": json.dumps(state["training"] | {"steps": state["step"]}),
    }


def sample_image() -> NDArray[np.float32]:
    """Return a rendered photograph (1, 3, 256, 320), RGB in [0, 1]."""
    scene = render(7, RenderOptions(size=(320, 256)))
    image = photograph(np.random.default_rng(7), scene.linear).astype(np.float32) / 255
    return np.asarray(np.ascontiguousarray(image.transpose(2, 0, 1)[None]), np.float32)


def sample() -> tuple[Tensor, Tensor]:
    """Return a rendered photograph and features of any values."""
    image = torch.from_numpy(sample_image())
    shape = (1, CHANNELS, image.shape[2] // STRIDE, image.shape[3] // STRIDE)
    return image, torch.from_numpy(np.random.default_rng(0).normal(0, 0.5, shape).astype(np.float32))


def export(checkpoint: Path, target: Path) -> None:
    """Write ``target``, when complete and checked.

    Raises
    ------
    Blur2ViewError
        If the checkpoint is none, or ONNX Runtime does not compute what torch does.
    """
    network, state = load_network(checkpoint)
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_suffix(".tmp.onnx")
    write_graph(network, temporary)
    graph = onnx.load(temporary)
    digest = hashlib.sha256(graph.SerializeToString()).hexdigest()
    onnx.helper.set_model_props(graph, metadata(state, digest))
    onnx.checker.check_model(graph)
    onnx.save(graph, temporary)
    worst = difference(temporary, network)
    if not worst <= LARGEST_DIFFERENCE:
        raise ModelError(f"{temporary} differs from torch by {worst:.2g}, so it does not replace {target}")
    temporary.replace(target)
    print(f"{target}: {target.stat().st_size / 1e6:.1f} MB, step {state['step']}, {worst:.1e} from torch")


def write_graph(network: MotionUNet, path: Path) -> None:
    """Trace the network into an ONNX file, dynamic in batch, height and width."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter announces its own deprecation and its tracing
        torch.onnx.export(
            network.eval(),
            sample(),
            str(path),
            input_names=["image", "features"],
            output_names=["moving"],
            dynamic_axes={
                "image": {0: "batch", 2: "height", 3: "width"},
                "features": {0: "batch", 2: "rows", 3: "columns"},
                "moving": {0: "batch", 2: "rows", 3: "columns"},
            },
            opset_version=17,
            dynamo=False,
        )


def difference(model: Path, network: MotionUNet) -> float:
    """Return the largest difference between ONNX Runtime and torch, of logits."""
    image, features = sample()
    with torch.no_grad():
        expected = network(image, features).numpy()
    session = onnxruntime.InferenceSession(str(model), providers=["CPUExecutionProvider"])
    (actual,) = session.run(["moving"], {"image": image.numpy(), "features": features.numpy()})
    return float(np.abs(actual - expected).max())


def main() -> None:
    """Export one checkpoint."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("target", type=Path)
    arguments = parser.parse_args()
    try:
        export(arguments.checkpoint, arguments.target)
    except (Blur2ViewError, OSError) as error:
        raise SystemExit(str(error)) from None


if __name__ == "__main__":
    main()
