"""What every export of a trained network to an ONNX file does."""

import hashlib
import json
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch
from onnxruntime.quantization import quantize_dynamic
from onnxruntime.quantization.quant_utils import add_pre_process_metadata
from torch import Tensor, nn

from blur2view.arrays import AnyArray
from blur2view.errors import ModelError
from blur2view.networks.mover_networks import NetworkFormat

LARGEST_DIFFERENCE = 2e-3  # between log-odds or logits of ONNX Runtime and torch
MOST_ROUNDED = 0.2
"""Root mean square of what integers change; the logits' deviations are 2 to 3."""
MOST_HALVED = 0.05
"""The same of half precision, where log-odds have deviations of 5."""


def export(
    target: Path,
    network: nn.Module,
    inputs: Mapping[str, Tensor],
    outputs: Sequence[str],
    axes: dict[str, dict[int, str]],
    samples: Sequence[Tensor],
    kind: str,
    facts: Mapping[str, object],
    properties: Mapping[str, str] | None = None,
    eight_bits: bool = False,
    half: bool = False,
) -> None:
    """Write a network, when complete and checked; ModelError if it does not compute what torch does.

    Parameters
    ----------
    target : Path
        Replaced only by a whole file.
    network : Module
        Traced on these ``inputs``, whose ``axes`` may have any length.
    samples : sequence of Tensor
        Further inputs, on which the file is compared with torch.
    kind : str
        The file's ``model_id`` is this and the first digits of its digest.
    facts, properties : mapping
        How it was trained, and what else the file says of itself.
    eight_bits : bool
        Whether products with stored matrices are computed on integers, which takes a third of the time, and
        weights keep their names, as what is constant is not computed.
    half : bool
        Whether weights are stored in half precision.
    """
    temporary = target.with_suffix(".tmp.onnx")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter announces its own deprecation and its tracing
        torch.onnx.export(
            network.eval(),
            tuple(inputs.values()),
            str(temporary),
            input_names=list(inputs),
            output_names=list(outputs),
            dynamic_axes=axes,
            opset_version=17,
            dynamo=False,
            do_constant_folding=not eight_bits,
        )
    graph = onnx.load(temporary)
    compared = dict(zip(inputs, samples, strict=True))
    worst = max(np.abs(one).max() for one in differences(temporary, network, compared))
    if not worst <= LARGEST_DIFFERENCE:
        raise ModelError(f"{temporary} differs from torch by {worst:.2g}, so it does not replace {target}")
    if eight_bits:
        graph = with_integers(graph, temporary)
        worst = max(np.sqrt(np.square(one).mean()) for one in differences(temporary, network, compared))
        if not worst <= MOST_ROUNDED:
            raise ModelError(f"{temporary}: integers change it by {worst:.2g}; {target} is not replaced")
    if half:
        store_half(graph.graph)
        onnx.save(graph, temporary)
        worst = max(np.sqrt(np.square(one).mean()) for one in differences(temporary, network, compared))
        if not worst <= MOST_HALVED:
            raise ModelError(
                f"{temporary}: half precision changes it by {worst:.2g}; {target} is not replaced"
            )
    digest = hashlib.sha256(graph.SerializeToString()).hexdigest()[:12]
    said = {"model_id": f"{kind}-{digest}", "license": "Apache-2.0", "training": json.dumps(facts)}
    onnx.helper.set_model_props(graph, {**said, **(properties or {})})
    onnx.checker.check_model(graph)
    onnx.save(graph, temporary)
    temporary.replace(target)
    print(f"{target}: {target.stat().st_size / 1e6:.1f} MB, {worst:.1e} from torch")


def export_mover_network(
    target: Path,
    form: NetworkFormat,
    network: nn.Module,
    channels: tuple[int, int],
    finer: int,
    facts: Mapping[str, object],
    half: bool = False,
) -> None:
    """Write a network of a format: of these channels, whose first input is so many times finer than cells."""
    shown, odd = (
        [torch.rand(1, count, by * h, by * w) for count, by in zip(channels, (finer, 1), strict=True)]
        for h, w in ((8, 12), (5, 7))
    )
    with torch.no_grad():
        said = network.eval()(*shown)
    odds = said[0] if isinstance(said, tuple) else said
    axes = {name: {2: "rows", 3: "columns"} for name in form.inputs}
    axes[form.outputs[0]] = {odds.ndim - 2: "rows", odds.ndim - 1: "columns"}
    inputs, properties = dict(zip(form.inputs, shown, strict=True)), {"blur2view_format": form.version}
    kind = form.file.removesuffix(".onnx")
    export(target, network, inputs, form.outputs, axes, odd, kind, facts, properties, half=half)


def store_half(graph: onnx.GraphProto) -> None:
    """Store weights in half precision, cast when the network is run."""
    for tensor in [
        one for one in graph.initializer if one.data_type == onnx.TensorProto.FLOAT and len(one.dims) > 1
    ]:
        half, name = onnx.numpy_helper.to_array(tensor).astype(np.float16), tensor.name
        tensor.CopyFrom(onnx.numpy_helper.from_array(half, f"{name}_half"))
        cast = onnx.helper.make_node("Cast", [f"{name}_half"], [name], to=onnx.TensorProto.FLOAT)
        graph.node.insert(0, cast)


def with_integers(model: onnx.ModelProto, scratch: Path) -> onnx.ModelProto:
    """Return a model whose products with stored matrices are of integers: values of 8 bits, weights of 7.

    No sum of theirs overflows on any processor, so that all compute the same.
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
