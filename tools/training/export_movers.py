"""Export a trained mover network to the ONNX file that the package ships.

``python -m tools.training.export_movers runs/movers/last.pt models/movers.onnx`` writes the averaged weights,
and checks the file against torch.
"""

import hashlib
import json
import warnings
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch

from blur2view.movers.network import INPUTS, OUTPUT
from tools.arguments import existing, parser_of, target
from tools.training.movers import CELLS, PLACES, Movers

LARGEST_DIFFERENCE = 2e-3  # between log-odds of ONNX Runtime and torch


def export(checkpoint: Path, path: Path) -> float:
    """Write the file, when complete and checked; return its largest difference from torch."""
    state = torch.load(checkpoint, map_location="cpu", weights_only=True)
    network = Movers().eval()
    network.load_state_dict(state["average"])
    temporary = path.with_suffix(".tmp.onnx")
    axes = {2: "rows", 3: "columns"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter announces its own deprecation and its tracing
        torch.onnx.export(
            network,
            (torch.rand(1, PLACES, 96, 128), torch.rand(1, CELLS, 12, 16)),
            str(temporary),
            input_names=list(INPUTS),
            output_names=[OUTPUT],
            dynamic_axes={name: axes for name in (*INPUTS, OUTPUT)},
            opset_version=17,
            dynamo=False,
        )
    graph = onnx.load(temporary)
    digest = hashlib.sha256(graph.SerializeToString()).hexdigest()
    facts = {"steps": state["step"], "pictures": state["step"] * state["batch"], "seed": state["seed"]}
    properties = {"model_id": f"movers-{digest[:12]}", "license": "Apache-2.0", "training": json.dumps(facts)}
    onnx.helper.set_model_props(graph, properties)
    onnx.checker.check_model(graph)
    onnx.save(graph, temporary)
    worst = difference(temporary, network)
    if not worst <= LARGEST_DIFFERENCE:
        raise SystemExit(f"{temporary} differs from torch by {worst:.2g}, so it does not replace {path}")
    temporary.replace(path)
    return worst


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


def main() -> None:
    """Export one checkpoint."""
    parser = parser_of(__doc__)
    parser.add_argument("checkpoint", type=existing)
    parser.add_argument("target", type=target)
    arguments = parser.parse_args()
    worst = export(arguments.checkpoint, arguments.target)
    size = arguments.target.stat().st_size / 1e6
    print(f"{arguments.target}: {size:.1f} MB, {worst:.1e} from torch")


if __name__ == "__main__":
    main()
