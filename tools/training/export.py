"""Export a trained network to the ONNX file that the package ships, checked against torch.

``python -m tools.training.export smear runs/smear/last.pt models/smear.onnx`` writes the averaged weights of
a checkpoint of `tools.training.train`, or their mean over several. The reader's products are of integers, the
U-Net's weights in half precision.
"""

import hashlib
import json
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
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
from blur2view.movers.moving import CELL_VALUES, PLACE_PX
from blur2view.networks.model_file import BLUR, SMEAR, UNET, NetworkFormat
from blur2view.networks.spectra import STEP, polar_cepstra, power_spectra, windows_of
from blur2view.smears.likelihood import DIRECTIONS
from tools.command import Existing, Target, run
from tools.rendering.render import RenderOptions, render
from tools.rendering.sensor import photograph
from tools.training.examples import Which
from tools.training.mover_networks import CELLS, PLACES, BlurNet, UNet
from tools.training.reader import Circular, Reader, ReaderOptions, clipped_shares

Rounding = Callable[[onnx.ModelProto, Path], onnx.ModelProto]

LARGEST_DIFFERENCE = 2e-3  # between log-odds or logits of ONNX Runtime and torch


@dataclass(frozen=True, kw_only=True)
class Export:
    """What is written: a network of a format, traced on ``inputs`` and compared with torch on ``samples``.

    ``axes`` are names of those that may have any length. ``rounded`` stores weights smaller, which may change
    outputs by ``most_rounded`` (root mean square; the reader's logits have deviations of 2 to 3, the U-Net's
    log-odds of 5).
    """

    network: nn.Module
    form: NetworkFormat
    inputs: Mapping[str, Tensor]
    samples: Mapping[str, Tensor]
    axes: dict[str, dict[int, str]]
    rounded: Rounding | None
    most_rounded: float


def write(target: Path, export: Export, facts: Mapping[str, object]) -> None:
    """Write a network when complete and checked; SystemExit if it does not compute what torch does.

    ``target`` is replaced only by a whole file; ``facts`` say how it was trained.
    """
    temporary, network, form = target.with_suffix(".tmp.onnx"), export.network.eval(), export.form
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter announces its own deprecation and its tracing
        torch.onnx.export(
            network,
            tuple(export.inputs.values()),
            str(temporary),
            input_names=list(form.inputs),
            output_names=list(form.outputs),
            dynamic_axes=export.axes,
            opset_version=17,
            dynamo=False,
            do_constant_folding=export.rounded is not with_integers,
        )
    graph = onnx.load(temporary)
    worst = max(np.abs(one).max() for one in differences(temporary, network, export.samples))
    most = LARGEST_DIFFERENCE
    if worst <= most and export.rounded is not None:
        graph, most = export.rounded(graph, temporary), export.most_rounded
        worst = max(np.sqrt(np.square(one).mean()) for one in differences(temporary, network, export.samples))
    if not worst <= most:
        raise SystemExit(f"{temporary} differs from torch by {worst:.2g}, so it does not replace {target}")
    digest = hashlib.sha256(graph.SerializeToString()).hexdigest()[:12]
    said = {
        "blur2view_format": form.version,
        "model_id": f"{form.file.removesuffix('.onnx')}-{digest}",
        "license": "Apache-2.0",
        "training": json.dumps(facts),
    }
    if form is SMEAR:
        said["brightness"] = str(BRIGHT)
    onnx.helper.set_model_props(graph, said)
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

    No sum of theirs overflows on any processor, so that all compute the same, in a third of the time.
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


def differences(path: Path, network: nn.Module, inputs: Mapping[str, Tensor]) -> list[AnyArray]:
    """Return how far ONNX Runtime's outputs are from torch's."""
    with torch.no_grad():
        expected = network.eval()(*inputs.values())
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    actual = session.run(None, {name: one.numpy() for name, one in inputs.items()})
    pairs = zip(actual, expected if isinstance(expected, tuple) else [expected], strict=True)
    return [one - other.numpy() for one, other in pairs]


class ExportedOctave(nn.Module):
    """What the reader's file computes: all that is learned, for one octave."""

    def __init__(self, network: Reader) -> None:
        super().__init__()
        self.network = network
        for layer in network.modules():
            if isinstance(layer, Circular):
                layer.store_matrix()

    def forward(self, grey: Tensor, *inputs: Tensor) -> tuple[Tensor, ...]:
        """Compute the outputs ``logits``, ``radii``, ``kinds`` and ``features``."""
        cepstra, scales, coarser = inputs
        scalars = torch.cat([scales, clipped_shares(grey)], -1)
        return self.network.octave(self.network.windows(cepstra, scalars), coarser)


class ExportedUNet(nn.Module):
    """What the package asks of the U-Net: log-odds of places (N, H/4, W/4), and of the camera (N,)."""

    def __init__(self, unet: UNet) -> None:
        super().__init__()
        self.unet = unet

    def forward(self, image: Tensor, cells: Tensor) -> tuple[Tensor, Tensor]:
        """Leave out the smears."""
        said, moved = self.unet(image, cells)
        return said[:, -1], moved


def sample_picture() -> Tensor:
    """Return a rendered grey picture (1, 1, 256, 320) in [0, 1]."""
    scene = render(7, RenderOptions(size=(320, 256)))
    image = photograph(np.random.default_rng(7), scene.linear).astype(np.float32) / 255
    return torch.from_numpy(np.ascontiguousarray(image.mean(-1)[None, None]))


def inputs_of(network: Reader, grey: Tensor) -> dict[str, Tensor]:
    """Return the inputs of the octave of a picture (1, 1, H, W), its smaller one's features at random."""
    read = polar_cepstra(power_spectra(windows_of(grey[0, 0].numpy())))
    cepstra, scales = (torch.from_numpy(one)[None] for one in read)
    coarser = torch.rand(*scales.shape[:3], DIRECTIONS, network.options.region)
    return dict(zip(SMEAR.inputs, (grey, cepstra, scales, coarser), strict=True))


def of_reader(network: Reader) -> Export:
    """Return what is written of a reader: one octave, traced and compared on a rendered picture."""
    cells, grey = {1: "rows", 2: "columns"}, sample_picture()
    return Export(
        network=ExportedOctave(network),
        form=SMEAR,
        inputs=inputs_of(network, grey[..., :128, :192].contiguous()),
        samples=inputs_of(network, grey),
        axes={name: cells for name in (*SMEAR.inputs, *SMEAR.outputs)} | {"grey": {2: "height", 3: "width"}},
        rounded=with_integers,
        most_rounded=0.2,
    )


def of_movers(network: UNet | BlurNet) -> Export:
    """Return what is written of a network that finds movers, traced and compared on noise."""
    is_unet = isinstance(network, UNet)
    form, rows = (UNET, 1) if is_unet else (BLUR, 2)
    fine, coarse, zoom = (3, CELL_VALUES, STEP) if is_unet else (PLACES, CELLS, STEP // PLACE_PX)
    inputs, samples = (
        dict(
            zip(
                form.inputs,
                (torch.rand(1, fine, zoom * h, zoom * w), torch.rand(1, coarse, h, w)),
                strict=True,
            )
        )
        for h, w in ((8, 12), (5, 7))
    )
    axes = {name: {2: "rows", 3: "columns"} for name in form.inputs}
    return Export(
        network=ExportedUNet(network) if isinstance(network, UNet) else network,
        form=form,
        inputs=inputs,
        samples=samples,
        axes=axes | {form.outputs[0]: {rows: "rows", rows + 1: "columns"}},
        rounded=with_halves if is_unet else None,
        most_rounded=0.05,
    )


def load_average(path: Path) -> dict[str, Any]:
    """Return what a checkpoint says; its averaged weights are ``average``, float32."""
    state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    weights: dict[str, Tensor] = state["average"] if "average" in state else state["unet"]
    return state | {"average": {k: v.float() if v.is_floating_point() else v for k, v in weights.items()}}


def main(which: Which, checkpoints: list[Existing], target: Target) -> None:
    """Export the mean of the weights of one or more checkpoints of a network."""
    states = [load_average(path) for path in checkpoints]
    weights = [state["average"] for state in states]
    mean = {name: torch.stack([one[name].double() for one in weights]).mean(0) for name in weights[0]}
    if which == "smear":
        reader = Reader(ReaderOptions(**states[0]["widths"]))
        reader.load_state_dict(mean)
        export = of_reader(reader)
    else:
        network = UNet() if which == "unet" else BlurNet()
        network.load_state_dict(mean)
        export = of_movers(network)
    facts = {name: states[0][name] for name in ("seed", "batch", "figures") if name in states[0]}
    write(target, export, facts | {"steps": [state.get("step") for state in states]})


if __name__ == "__main__":
    run(main)
