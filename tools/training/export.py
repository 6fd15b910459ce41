"""What every export of a trained network to an ONNX file does."""

import hashlib
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch
from torch import Tensor, nn

from blur2view.errors import ModelError

LARGEST_DIFFERENCE = 2e-3  # between log-odds or logits of ONNX Runtime and torch


def export(
    target: Path,
    network: nn.Module,
    inputs: Mapping[str, Tensor],
    outputs: Sequence[str],
    axes: dict[str, dict[int, str]],
    properties: Callable[[str], dict[str, str]],
    samples: Sequence[Tensor],
    fold: bool = True,
) -> None:
    """Write a network, when complete and checked; ModelError if it does not compute what torch does.

    Parameters
    ----------
    target : Path
        Replaced only by a whole file.
    network : Module
        Traced on these ``inputs``, whose ``axes`` may have any length.
    properties : callable
        What the file says of itself, given the first digits of its own digest.
    samples : sequence of Tensor
        Further inputs, on which the file is compared with torch.
    fold : bool
        Whether what is constant is computed; weights then lose their names.
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
            do_constant_folding=fold,
        )
    graph = onnx.load(temporary)
    separate_weights(graph)
    digest = hashlib.sha256(graph.SerializeToString()).hexdigest()[:12]
    onnx.helper.set_model_props(graph, properties(digest))
    onnx.checker.check_model(graph)
    onnx.save(graph, temporary)
    worst = difference(temporary, network, dict(zip(inputs, samples, strict=True)))
    if not worst <= LARGEST_DIFFERENCE:
        raise ModelError(f"{temporary} differs from torch by {worst:.2g}, so it does not replace {target}")
    temporary.replace(target)
    print(f"{target}: {target.stat().st_size / 1e6:.1f} MB, {worst:.1e} from torch")


def separate_weights(model: onnx.ModelProto) -> None:
    """Store equal weights, as those of a fresh network are, once for each name."""
    weights = {tensor.name: tensor for tensor in model.graph.initializer}
    for node in [node for node in model.graph.node if node.op_type == "Identity"]:
        copy = model.graph.initializer.add()
        copy.CopyFrom(weights[node.input[0]])
        copy.name = node.output[0]
        model.graph.node.remove(node)


def difference(path: Path, network: nn.Module, inputs: Mapping[str, Tensor]) -> float:
    """Return the largest difference between ONNX Runtime's outputs and torch's."""
    with torch.no_grad():
        expected = network.eval()(*inputs.values())
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    actual = session.run(None, {name: one.numpy() for name, one in inputs.items()})
    pairs = zip(actual, expected if isinstance(expected, tuple) else [expected], strict=True)
    return max(float(np.abs(one - other.numpy()).max()) for one, other in pairs)
