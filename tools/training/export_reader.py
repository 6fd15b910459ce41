"""Export a trained reader to the ONNX file that the package ships.

``python -m tools.training.export_reader runs/reader/last.pt models/smear.onnx`` writes the averaged weights
with the metadata that :mod:`blur2view.networks.model_file` reads, and checks the file against torch on a
rendered picture.
"""

import hashlib
import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import torch
from torch import Tensor, nn

from blur2view.errors import ModelError
from blur2view.networks.brightness import BRIGHT
from blur2view.networks.model_file import FORMAT, INPUTS, OUTPUTS
from blur2view.networks.spectra import LAGS, SCALES, STEP, polar_cepstra, power_spectra, windows_of
from blur2view.smears.likelihood import DIRECTIONS
from tools.arguments import existing, parser_of, target
from tools.rendering.render import RenderOptions, render
from tools.rendering.sensor import photograph
from tools.training.reader import Reader
from tools.training.spectra import Spectra, clipped_shares, padded_picture
from tools.training.train_reader import load_average

LARGEST_DIFFERENCE = 2e-3  # between logits of ONNX Runtime and torch
CONVENTION = (
    "one octave of a photograph; inputs: grey (1,1,H,W) float32, sRGB-coded luma, 0 to 1, H and W "
    "multiples of 32 and at least 64; cepstra (1,H/32,W/32,32,45) and scales (1,H/32,W/32,3) of its windows "
    "of 96 px as blur2view.networks.spectra gives them; "
    "coarser (1,H/32,W/32,32,C): features of the octave half the size, each cell repeated 2 x 2, or zeros; "
    "outputs: logits (1,H/32,W/32,32,20) over direction (180 k / 32 degrees) and length (shorter, 2 px "
    "and up, four an octave, longer), radii (1,H/32,W/32,20) over radius out of focus (smaller, 0.7 px and "
    "up, four an octave, larger), kinds (1,H/32,W/32,5): sharp, out of focus, smeared, both, cannot tell; "
    "features (1,H/32,W/32,32,C); cell j is centred at pixel 32*j + 15.5"
)


class ExportedOctave(nn.Module):
    """What the ONNX file computes: all that is learned, for one octave."""

    def __init__(self, network: Reader) -> None:
        super().__init__()
        self.network = network

    def forward(self, grey: Tensor, *inputs: Tensor) -> tuple[Tensor, ...]:
        """Compute the outputs ``logits``, ``radii``, ``kinds`` and ``features``."""
        cepstra, scales, coarser = inputs
        scalars = torch.cat([scales, clipped_shares(padded_picture(grey))], -1)
        return self.network.octave(self.network.windows(cepstra, scalars), coarser)


def metadata(state: dict[str, Any], digest: str) -> dict[str, str]:
    """Describe the file: format, geometry, licence and how it was trained."""
    training = {
        "seed": state["options"]["seed"],
        "steps": state["step"],
        "pictures": state["step"] * state["options"]["batch"],
        "figures": state["figures"],
    }
    return {
        "blur2view_format": FORMAT,
        "model_id": f"smear-{digest[:12]}",
        "stride": str(STEP),
        "multiple_of": str(STEP),
        "brightness": str(BRIGHT),
        "convention": CONVENTION,
        "license": "Apache-2.0",
        "training": json.dumps(training),
    }


def export(checkpoint: Path, target: Path) -> None:
    """Write `target`, when complete and checked; ModelError if it does not compute what torch does."""
    network, state = load_average(checkpoint)
    temporary = target.with_suffix(".tmp.onnx")
    write_graph(network, temporary)
    graph = onnx.load(temporary)
    separate_weights(graph)
    digest = hashlib.sha256(graph.SerializeToString()).hexdigest()
    onnx.helper.set_model_props(graph, metadata(state, digest))
    onnx.checker.check_model(graph)
    onnx.save(graph, temporary)
    worst = difference(temporary, network, sample_picture())
    if not worst <= LARGEST_DIFFERENCE:
        raise ModelError(f"{temporary} differs from torch by {worst:.2g}, so it does not replace {target}")
    temporary.replace(target)
    print(f"{target}: {target.stat().st_size / 1e6:.1f} MB, step {state['step']}, {worst:.1e} from torch")


def write_graph(network: Reader, path: Path) -> None:
    """Trace one octave's reader into an ONNX file, dynamic in height and width.

    The weights keep their names, so that a training can start from the file; ONNX Runtime rearranges them
    when it loads it.
    """
    cells = {1: "rows", 2: "columns"}
    windows = (1, 4, 6)
    shown = torch.rand(*windows, DIRECTIONS, LAGS), torch.rand(*windows, SCALES)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter announces its own deprecation and its tracing
        torch.onnx.export(
            ExportedOctave(network).eval(),
            (torch.rand(1, 1, 128, 192), *shown, torch.zeros(*windows, DIRECTIONS, network.options.region)),
            str(path),
            input_names=INPUTS,
            output_names=OUTPUTS,
            dynamic_axes={name: cells for name in (*INPUTS, *OUTPUTS)} | {"grey": {2: "height", 3: "width"}},
            opset_version=17,
            do_constant_folding=False,
            dynamo=False,
        )


def separate_weights(model: onnx.ModelProto) -> None:
    """Store equal weights, as those of a fresh network are, once for each name."""
    weights = {tensor.name: tensor for tensor in model.graph.initializer}
    for node in [node for node in model.graph.node if node.op_type == "Identity"]:
        copy = model.graph.initializer.add()
        copy.CopyFrom(weights[node.input[0]])
        copy.name = node.output[0]
        model.graph.node.remove(node)


def sample_picture() -> Tensor:
    """Return a rendered grey picture (1, 1, 256, 320) in [0, 1]."""
    scene = render(7, RenderOptions(size=(320, 256)))
    image = photograph(np.random.default_rng(7), scene.linear).astype(np.float32) / 255
    return torch.from_numpy(np.ascontiguousarray(image.mean(-1)[None, None]))


def difference(model: Path, network: Reader, grey: Tensor) -> float:
    """Return the largest difference of logits between NumPy with ONNX Runtime and torch alone."""
    network.eval()
    shape = (1, grey.shape[2] // STEP, grey.shape[3] // STEP, 32, network.options.region)
    coarser = torch.rand(shape, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        expected = network.octave(network.windows(*Spectra()(grey)), coarser)
    session = onnxruntime.InferenceSession(str(model), providers=["CPUExecutionProvider"])
    cepstra, scales = polar_cepstra(power_spectra(windows_of(grey[0, 0].numpy())))
    inputs = grey.numpy(), cepstra[None], scales[None], coarser.numpy()
    actual = session.run(None, dict(zip(INPUTS, inputs, strict=True)))
    pairs = zip(actual[:3], expected[:3], strict=True)
    return max(float(np.abs(one - other.numpy()).max()) for one, other in pairs)


def main() -> None:
    """Export one checkpoint."""
    parser = parser_of(__doc__)
    parser.add_argument("checkpoint", type=existing)
    parser.add_argument("target", type=target)
    arguments = parser.parse_args()
    try:
        export(arguments.checkpoint, arguments.target)
    except ModelError as error:
        raise SystemExit(str(error)) from None


if __name__ == "__main__":
    main()
