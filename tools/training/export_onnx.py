"""Export a checkpoint to the ONNX file that the package ships.

``python -m tools.training.export_onnx runs/smear/last.pt models/smear.onnx`` writes the averaged weights,
dynamic in height and width, with the metadata that `networks.model_file` reads and a reader wants to know,
and checks the file against torch on a rendered picture.
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

from blur2view.errors import ModelError
from blur2view.networks.model_file import FORMAT
from tools.rendering.render import RenderOptions, render
from tools.rendering.sensor import photograph
from tools.training.checkpoint import load_average, save_average
from tools.training.model import MULTIPLE_OF, ExportedSmear, SmearUNet
from tools.training.stem import STRIDE

Images = NDArray[np.float32]

LARGEST_DIFFERENCE_PX = 1e-3
LONGEST_PX = 48.0
"""Smears up to this length are measured at an image's own size; see ``blur2view/networks/pyramid.py``."""

CONVENTION = (
    "input: image (N,3,H,W) float32 RGB, sRGB-coded, 0 to 1; output: smear (N,4,H/stride,W/stride): "
    "|d| cos 2phi, |d| sin 2phi, sigma of d, in input pixels, sigma of phi in radians; "
    "d = end - start up to sign; cell j is centred at pixel stride*j + (stride-1)/2"
)


def metadata(state: dict[str, Any], digest: str) -> dict[str, str]:
    """Describe the file: format, geometry, licence and how it was trained."""
    options, steps = state["options"], state["step"] + state["steps_before"]
    training = {
        "seed": options["seed"],
        "steps": steps,
        "crops": steps * options["batch"] * options.get("processes", 1),
        "scenes": state["scenes"],
        "figures": {name: round(value, 4) for name, value in state["figures"].items()},
    }
    return {
        "blur2view_format": FORMAT,
        "model_id": f"smear-{digest[:12]}",
        "stride": str(STRIDE),
        "multiple_of": str(MULTIPLE_OF),
        "longest_px": str(LONGEST_PX),
        "convention": CONVENTION,
        "license": "Apache-2.0",
        "training": json.dumps(training),
    }


def export(checkpoint: Path, target: Path) -> None:
    """Write `target`, when complete and checked, and beside it the weights as ``.pt``.

    Raises
    ------
    ModelError
        If ONNX Runtime does not compute what torch does, to 1e-3 (px, and radians in the last channel).
    """
    network, state = load_average(checkpoint)
    temporary = target.with_suffix(".tmp.onnx")
    write_graph(network, temporary)
    graph = onnx.load(temporary)
    digest = hashlib.sha256(graph.SerializeToString()).hexdigest()
    onnx.helper.set_model_props(graph, metadata(state, digest))
    onnx.checker.check_model(graph)
    onnx.save(graph, temporary)
    worst = difference_px(temporary, network, sample_image())
    if not worst <= LARGEST_DIFFERENCE_PX:
        raise ModelError(f"{temporary} differs from torch by {worst:.2g} px, so it does not replace {target}")
    temporary.replace(target)
    save_average(checkpoint, target.with_suffix(".pt"))
    print(f"{target}: {target.stat().st_size / 1e6:.1f} MB, step {state['step']}, {worst:.1e} px from torch")


def write_graph(network: SmearUNet, path: Path) -> None:
    """Trace the network with its decoding into an ONNX file, dynamic in batch, height and width."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter announces its own deprecation and its tracing
        torch.onnx.export(
            ExportedSmear(network).eval(),
            (torch.zeros(1, 3, 128, 192),),
            str(path),
            input_names=["image"],
            output_names=["smear"],
            dynamic_axes={
                "image": {0: "batch", 2: "height", 3: "width"},
                "smear": {0: "batch", 2: "rows", 3: "columns"},
            },
            opset_version=17,
            dynamo=False,
        )


def sample_image() -> Images:
    """Return a rendered photograph (1, 3, 256, 320), float32 in [0, 1]."""
    scene = render(7, RenderOptions(size=(320, 256)))
    image = photograph(np.random.default_rng(7), scene.linear).astype(np.float32) / 255
    return np.ascontiguousarray(image.transpose(2, 0, 1)[None])


def difference_px(model: Path, network: SmearUNet, images: Images) -> float:
    """Give the largest difference between ONNX Runtime and torch on images (N, 3, H, W), pixels."""
    with torch.no_grad():
        expected = ExportedSmear(network).eval()(torch.from_numpy(images)).numpy()
    session = onnxruntime.InferenceSession(str(model), providers=["CPUExecutionProvider"])
    (actual,) = session.run(["smear"], {"image": images})
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
    except ModelError as error:
        raise SystemExit(str(error)) from None


if __name__ == "__main__":
    main()
