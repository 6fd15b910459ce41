"""Export a trained mover network to the ONNX file that the package ships.

``python -m tools.training.export_movers runs/movers/last.pt models/movers.onnx`` writes the averaged weights,
and checks the file against torch.
"""

import json
from functools import partial
from pathlib import Path

import numpy as np
import onnxruntime
import torch

from blur2view.movers.network import INPUTS, OUTPUT
from tools.arguments import Existing, Target, run
from tools.training.export import export
from tools.training.movers import CELLS, PLACES, Movers


def difference(path: Path, network: Movers) -> float:
    """Return the largest difference of log-odds between ONNX Runtime and torch, of an odd number of cells."""
    generator = torch.Generator().manual_seed(0)
    shapes = (1, PLACES, 8 * 7, 8 * 13), (1, CELLS, 7, 13)
    inputs = [torch.rand(shape, generator=generator) for shape in shapes]
    with torch.no_grad():
        expected = network(*inputs).numpy()
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    (actual,) = session.run(None, dict(zip(INPUTS, (one.numpy() for one in inputs), strict=True)))
    return float(np.abs(actual - expected).max())


def main(checkpoint: Existing, target: Target) -> None:
    """Export one checkpoint."""
    state = torch.load(checkpoint, map_location="cpu", weights_only=True)
    network = Movers().eval()
    network.load_state_dict(state["average"])
    facts = {"steps": state["step"], "pictures": state["step"] * state["batch"], "seed": state["seed"]}
    shown = torch.rand(1, PLACES, 96, 128), torch.rand(1, CELLS, 12, 16)
    export(
        target,
        network,
        dict(zip(INPUTS, shown, strict=True)),
        [OUTPUT],
        {name: {2: "rows", 3: "columns"} for name in (*INPUTS, OUTPUT)},
        lambda digest: {
            "model_id": f"movers-{digest}", "license": "Apache-2.0", "training": json.dumps(facts),
        },
        partial(difference, network=network),
    )  # fmt: skip


if __name__ == "__main__":
    run(main)
