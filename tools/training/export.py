"""Export a trained network to the ONNX file that the package ships, checked against torch.

``python -m tools.training.export smear runs/smear/last.pt models/smear.onnx`` writes the averaged weights of
a checkpoint of `tools.training.train`, or their mean over several. The smear network's products are of
integers, the weights of the others in half precision.
"""

import hashlib
import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import torch
from onnxruntime.quantization import quantize_dynamic
from onnxruntime.quantization.quant_utils import add_pre_process_metadata
from torch import Tensor, nn

from blur2view.arrays import AnyArray
from blur2view.images.pixels import BRIGHT
from blur2view.movers.moving import BLOCK_PX, CELL_VALUES
from blur2view.networks.model_file import MOVERS, SMEAR, UNET, NetworkFormat
from blur2view.networks.spectra import STEP, polar_cepstra, power_spectra, sliding_windows
from blur2view.smears.likelihood import DIRECTIONS
from tools.command import Existing, Target, run
from tools.rendering.render import RenderOptions, render
from tools.rendering.sensor import photograph
from tools.training.examples import Which
from tools.training.mover_networks import CELLS, PIXEL_BLOCKS, BlurNet, UNet
from tools.training.reader import Reader, ReaderOptions, clipped_shares

Inputs = dict[str, Tensor]

MAX_DIFFERENCE = 2e-3
"""Of logits or log-odds of ONNX Runtime and torch before weights are rounded; bound."""
MAX_ROUNDED = {SMEAR.file: 0.2, UNET.file: 0.05, MOVERS.file: 0.05}
"""Root mean square of what rounding changes: the smear network's logits have deviations of 2 to 3, log-odds
of the U-Net of 5; bounds."""


class Exported(nn.Module):
    """The function of a file: ``outputs`` of a network and the file's inputs."""

    def __init__(self, network: nn.Module, outputs: Callable[..., tuple[Tensor, ...]]) -> None:
        super().__init__()
        self.network, self.outputs = network, outputs
        self.eval()

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        """Compute the outputs of the file."""
        return self.outputs(self.network, *inputs)


def octave_of(
    network: Reader, grey: Tensor, cepstra: Tensor, scales: Tensor, coarser: Tensor
) -> tuple[Tensor, ...]:
    """Return the smear network's logits, radii, kinds and features of an octave."""
    scalars = torch.cat([scales, clipped_shares(grey)], -1)
    return network.octave(network.windows(cepstra, scalars), coarser)


def looks_of(network: UNet, image: Tensor, cells: Tensor) -> tuple[Tensor, ...]:
    """Return the U-Net's log-odds of blocks (N, H/4, W/4), and of the camera (N,); not its smears."""
    said, moved = network(image, cells)
    return said[:, -1], moved


def blurred_of(network: BlurNet, blocks: Tensor, cells: Tensor) -> tuple[Tensor, ...]:
    """Return the log-odds of blocks (N, H/4, W/4) that they move; not those of smears that are read right."""
    return (network(blocks, cells)[:, 0],)


def write(
    target: Path,
    network: Exported,
    form: NetworkFormat,
    inputs: Sequence[Inputs],
    facts: Mapping[str, object],
) -> None:
    """Write a network when complete and checked; SystemExit if it does not compute what torch does.

    It is traced on the first ``inputs`` and compared on the second; axes in which these differ may have any
    length. ``target`` is replaced only by a whole file; ``facts`` say how it was trained.
    """
    temporary, is_smear = target.with_suffix(".tmp.onnx"), form is SMEAR
    small, large = inputs
    with torch.no_grad():
        one, other = (
            [*given.items(), *zip(form.outputs, network(*given.values()), strict=True)] for given in inputs
        )
    axes = {
        name: {k: f"{name}_{k}" for k in range(a.ndim) if a.shape[k] != b.shape[k]}
        for (name, a), (_, b) in zip(one, other, strict=True)
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter announces its own deprecation and its tracing
        torch.onnx.export(
            network,
            tuple(small.values()),
            str(temporary),
            input_names=list(form.inputs),
            output_names=list(form.outputs),
            dynamic_axes=axes,
            opset_version=17,
            dynamo=False,
            do_constant_folding=not is_smear,
        )
    worst = max(np.abs(one).max() for one in differences(temporary, network, large))
    bound, rounded = MAX_DIFFERENCE, with_integers if is_smear else with_halves
    if worst <= bound:
        graph, bound = rounded(onnx.load(temporary), temporary), MAX_ROUNDED[form.file]
        worst = max(np.sqrt(np.square(one).mean()) for one in differences(temporary, network, large))
    if not worst <= bound:
        raise SystemExit(f"{temporary} differs from torch by {worst:.2g}, so it does not replace {target}")
    digest = hashlib.sha256(graph.SerializeToString()).hexdigest()[:12]
    metadata = {
        "blur2view_format": form.version,
        "model_id": f"{form.file.removesuffix('.onnx')}-{digest}",
        "license": "Apache-2.0",
        "training": json.dumps(facts),
    }
    onnx.helper.set_model_props(graph, metadata | ({"brightness": str(BRIGHT)} if is_smear else {}))
    onnx.checker.check_model(graph)
    onnx.save(graph, temporary)
    temporary.replace(target)
    print(f"{target}: {target.stat().st_size / 1e6:.1f} MB, {worst:.1e} from torch")


def with_halves(model: onnx.ModelProto, scratch: Path) -> onnx.ModelProto:
    """Return a model whose weights are stored in half precision, cast when it is run."""
    graph = model.graph
    for tensor in graph.initializer:
        if tensor.data_type == onnx.TensorProto.FLOAT and len(tensor.dims) > 1:
            half, name = onnx.numpy_helper.to_array(tensor).astype(np.float16), tensor.name
            tensor.CopyFrom(onnx.numpy_helper.from_array(half, f"{name}_half"))
            cast = onnx.helper.make_node("Cast", [f"{name}_half"], [name], to=onnx.TensorProto.FLOAT)
            graph.node.insert(0, cast)
    onnx.save(model, scratch)
    return model


def with_integers(model: onnx.ModelProto, scratch: Path) -> onnx.ModelProto:
    """Return a model whose products with stored matrices are of integers: values of 8 bits, weights of 7.

    No sum overflows on any processor, so that all compute the same, in a third of the time.
    """
    add_pre_process_metadata(model)  # or it logs advice on what does not concern our layers
    quantize_dynamic(
        model, scratch, op_types_to_quantize=["MatMul"], per_channel=True, reduce_range=True,
    )  # fmt: skip
    integers = onnx.load(scratch)
    gather_rounded(integers.graph)
    onnx.save(integers, scratch)
    return integers


def gather_rounded(graph: onnx.GraphProto) -> None:
    """Round before values are gathered and reshaped, not after: once instead of thrice, and of 8 bits."""
    maker = {node.output[0]: node for node in graph.node}
    for rounding in [node for node in graph.node if node.op_type == "DynamicQuantizeLinear"]:
        reshape = maker[rounding.input[0]]
        gather = maker.get(reshape.input[0])
        if gather is None or (reshape.op_type, gather.op_type) != ("Reshape", "Gather"):
            continue
        rounded = rounding.output[0]
        rounding.input[0], rounding.output[0] = gather.input[0], f"{rounded}_whole"
        gather.input[0], gather.output[0] = rounding.output[0], f"{rounded}_near"
        reshape.input[0], reshape.output[0] = gather.output[0], rounded
        graph.node.remove(rounding)
        graph.node.insert(list(graph.node).index(gather), rounding)
    del graph.value_info[:]


def differences(path: Path, network: nn.Module, inputs: Inputs) -> list[AnyArray]:
    """Return ONNX Runtime's outputs less torch's."""
    with torch.no_grad():
        expected = network(*inputs.values())
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    actual = session.run(None, {name: one.numpy() for name, one in inputs.items()})
    return [one - other.numpy() for one, other in zip(actual, expected, strict=True)]


def sample_picture() -> Tensor:
    """Return a rendered grey picture (1, 1, 256, 320) in [0, 1]."""
    scene = render(7, RenderOptions(size=(320, 256)))
    image = photograph(np.random.default_rng(7), scene.linear).astype(np.float32) / 255
    return torch.from_numpy(np.ascontiguousarray(image.mean(-1)[None, None]))


def smear_inputs(network: Reader, grey: Tensor) -> Inputs:
    """Return the inputs of the octave of a picture (1, 1, H, W), with random features of the smaller one."""
    read = polar_cepstra(power_spectra(sliding_windows(grey[0, 0].numpy())))
    cepstra, scales = (torch.from_numpy(one)[None] for one in read)
    coarser = torch.rand(*scales.shape[:3], DIRECTIONS, network.options.region)
    return dict(zip(SMEAR.inputs, (grey, cepstra, scales, coarser), strict=True))


def mover_inputs(form: NetworkFormat, rows: int, columns: int) -> Inputs:
    """Return noise as the inputs of a mover network for a number of cells."""
    fine, coarse, zoom = (3, CELL_VALUES, STEP) if form is UNET else (PIXEL_BLOCKS, CELLS, STEP // BLOCK_PX)
    noise = torch.rand(1, fine, zoom * rows, zoom * columns), torch.rand(1, coarse, rows, columns)
    return dict(zip(form.inputs, noise, strict=True))


def load_average(path: Path) -> dict[str, Any]:
    """Return the content of a checkpoint; ``average`` are its averaged weights, float32."""
    state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    weights: dict[str, Tensor] = state["average"] if "average" in state else state["unet"]
    return state | {"average": {k: v.float() if v.is_floating_point() else v for k, v in weights.items()}}


def main(which: Which, checkpoints: list[Existing], target: Target) -> None:
    """Export the mean of the weights of one or more checkpoints of a network."""
    states = [load_average(path) for path in checkpoints]
    weights = [state["average"] for state in states]
    mean = {name: torch.stack([one[name].double() for one in weights]).mean(0) for name in weights[0]}
    facts = {"steps": [state.get("step") for state in states]}
    facts |= {name: states[0][name] for name in ("seed", "batch", "figures") if name in states[0]}
    if which == "smear":
        reader, grey = Reader(ReaderOptions(**states[0]["widths"])), sample_picture()
        reader.load_state_dict(mean)
        reader.store_matrices()
        pictures = grey[..., :128, :192].contiguous(), grey
        write(target, Exported(reader, octave_of), SMEAR, [smear_inputs(reader, p) for p in pictures], facts)
        return
    network, outputs, form = (UNet(), looks_of, UNET) if which == "unet" else (BlurNet(), blurred_of, MOVERS)
    network.load_state_dict(mean)
    inputs = [mover_inputs(form, *size) for size in ((8, 12), (5, 7))]
    write(target, Exported(network, outputs), form, inputs, facts)


if __name__ == "__main__":
    run(main)
