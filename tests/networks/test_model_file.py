"""The network's file: what it says of itself, and what is refused in one line."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from blur2view.errors import ModelError
from blur2view.networks import model_file
from blur2view.networks.model_file import OPERATORS, model_path, open_session
from blur2view.networks.onnx_operators import MAX_NODES, operators
from blur2view.networks.smear_network import SmearNetwork
from tests.support.colour_code import colour_code_network, noise


def test_network_tells_what_it_is(tiny_model: Path) -> None:
    info = SmearNetwork(tiny_model).info
    assert (info.model_id, info.stride, info.multiple_of) == ("colour-code", 32, 32)
    assert info.training == {"seed": 0}


def test_shipped_network_is_found_in_the_source_tree_and_others_by_their_path() -> None:
    models = Path(__file__).resolve().parents[2] / "models"
    assert model_path(None) == model_path("default") == models / "smear.onnx"
    assert model_path("./default") == model_path(Path("default")) == Path("default")
    assert model_path("fast") == Path("fast")


def renamed_network(old: str, new: str) -> onnx.ModelProto:
    """Return the tiny network with another name for an input or output."""
    model = colour_code_network()
    for value in (*model.graph.input, *model.graph.output):
        value.name = new if value.name == old else value.name
    for node in model.graph.node:
        for names in (node.input, node.output):
            names[:] = [new if name == old else name for name in names]
    return model


def endless_network() -> onnx.ModelProto:
    """Return the tiny network with a loop that never ends, though nobody asks for what it computes."""
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["on"])],
        "body",
        [
            helper.make_tensor_value_info(n, t, [])
            for n, t in (("i", TensorProto.INT64), ("go", TensorProto.BOOL))
        ],
        [helper.make_tensor_value_info("on", TensorProto.BOOL, [])],
    )
    model = colour_code_network()
    model.graph.node.append(helper.make_node("Loop", ["", "true"], [], body=body))
    model.graph.initializer.append(onnx.numpy_helper.from_array(np.array(True), "true"))
    return model


def foreign_network(domain: str = "", function: bool = False, features: bool = False) -> onnx.ModelProto:
    """Return the tiny network with somebody else's node, or a function, or any number of features."""
    model = colour_code_network()
    model.graph.node[0].domain = domain
    if function:
        node, opset = helper.make_node("Identity", ["x"], ["y"]), [helper.make_opsetid("", 17)]
        model.functions.append(helper.make_function("own", "Relu", ["x"], ["y"], [node], opset))
    if features:
        model.graph.input[3].type.tensor_type.shape.dim[4].dim_param = "C"
    return model


def with_attribute(**attribute: Any) -> onnx.ModelProto:
    """Return the tiny network with a further node that has an attribute."""
    model = colour_code_network()
    model.graph.node.append(helper.make_node("Constant", [], ["more"], **attribute))
    return model


def with_weights_elsewhere() -> onnx.TensorProto:
    """Return weights that another file holds, which anybody may name."""
    weights = TensorProto(name="w", data_type=1, dims=[4], data_location=TensorProto.EXTERNAL)
    weights.external_data.add(key="location", value="/etc/passwd")
    return weights


def computing(*nodes: onnx.NodeProto, **constants: np.typing.NDArray[np.generic]) -> onnx.ModelProto:
    """Return the tiny network with nodes of which the last gives ``costly``, on which its logits depend."""
    model = colour_code_network()
    model.graph.node[-2].output[:] = ["some"]
    last = [
        helper.make_node("ReduceMean", ["costly"], ["mean"], keepdims=0),
        helper.make_node("Add", ["some", "mean"], ["logits"]),
    ]
    model.graph.node.extend([*nodes, *last, model.graph.node.pop()])
    model.graph.initializer.extend(onnx.numpy_helper.from_array(a, name) for name, a in constants.items())
    return model


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot read the network"),
        (b"", "not an ONNX network"),
        (b"not a network", "not an ONNX network"),
        (colour_code_network().SerializeToString()[:200], "not an ONNX network"),
        (colour_code_network().SerializeToString().replace(b"Pool", b"Poo\xff"), "what no blur2view"),
        (colour_code_network().SerializeToString().replace(b"CC0", b"CC\xff"), "damaged metadata"),
        (colour_code_network().SerializeToString().replace(b"logits", b"logit\xff"), "damaged metadata"),
        (colour_code_network(blur2view_format="4").SerializeToString(), "is not .* of format 3"),
        (colour_code_network(blur2view_format="").SerializeToString(), "is not .* of format 3"),
        (colour_code_network(blur2view_format="2").SerializeToString(), "of format 2, of an earlier version"),
        (renamed_network("logits", "smear").SerializeToString(), "other inputs or outputs than grey, cep"),
        (renamed_network("scales", "image").SerializeToString(), "other inputs or outputs than grey, cep"),
        (endless_network().SerializeToString(), "what no blur2view network has .*Loop"),
        (foreign_network("com.microsoft").SerializeToString(), "what no .*com.microsoft.Slice"),
        (foreign_network("\x1b[31m\n").SerializeToString(), r"what no .*x1b\[31m.n.Slice"),
        (foreign_network(function=True).SerializeToString(), "what no blur2view network has .*a function"),
        (with_attribute(value=with_weights_elsewhere()).SerializeToString(), "weights in another file"),
        (with_attribute(kernel_shape=[3, 4000]).SerializeToString(), "an integer of 4000"),
        (with_attribute(group=33).SerializeToString(), "an integer of 33"),
        (with_attribute(body=colour_code_network().graph).SerializeToString(), "a subgraph"),
        (with_attribute(bodies=[colour_code_network().graph]).SerializeToString(), "a subgraph"),
        (foreign_network(features=True).SerializeToString(), "does not fix the number of its features"),
        (colour_code_network(stride="four").SerializeToString(), "damaged metadata"),
        (colour_code_network(stride="16").SerializeToString(), "windows 16 px apart instead of 32"),
        (colour_code_network(multiple_of="4000000000").SerializeToString(), "instead of 32"),
        (colour_code_network(training="{").SerializeToString(), "damaged metadata"),
        (colour_code_network(training="[" * 200_000).SerializeToString(), "damaged metadata"),
    ],
)
def test_wrong_network_file_is_named_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], content: bytes | None, words: str
) -> None:
    path = tmp_path / "wrong.onnx"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ModelError, match=words) as caught:
        SmearNetwork(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")  # ONNX Runtime adds no lines of its own


def test_pipe_is_no_network(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.onnx")
    for path in (tmp_path / "pipe.onnx", Path("/dev/zero")):
        with pytest.raises(ModelError, match="is no regular file"):
            SmearNetwork(path)


def test_file_of_absurd_size_is_no_network(tmp_path: Path) -> None:
    with (tmp_path / "huge.onnx").open("wb") as file:
        file.truncate(1 << 34)  # sparse
    with pytest.raises(ModelError, match="is larger than 256 MiB"):
        SmearNetwork(tmp_path / "huge.onnx")


def test_onnx_runtime_sends_nothing_and_writes_nothing(tiny_model: Path, tmp_path: Path) -> None:
    code = "import sys; from blur2view.networks.smear_network import SmearNetwork; SmearNetwork(sys.argv[1])"
    hidden = ("ORT_DISABLE_TELEMETRY", "XDG_CACHE_HOME")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    environment |= {"HOME": str(tmp_path), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    subprocess.run([sys.executable, "-c", code, tiny_model], env=environment, check=True)
    assert list(tmp_path.rglob("*")) == []  # its device id and what it sends lie there


def test_operators_are_read_off_the_shipped_network() -> None:
    path = model_path(None)
    content = path.read_bytes()
    assert operators(content) == {node.op_type for node in onnx.load(path).graph.node} == OPERATORS
    for length in range(0, 4000, 7):  # what is cut or damaged is read, or refused
        for damaged in (content[:length], content[:length] + b"\xff" * 12 + content[length + 12 : 5000]):
            try:
                assert all(isinstance(name, str) for name in operators(damaged))
            except ValueError:
                continue


def test_weights_in_another_file_are_refused(tmp_path: Path) -> None:
    model = colour_code_network()
    model.graph.initializer.append(with_weights_elsewhere())
    onnx.save(model, tmp_path / "a.onnx")
    with pytest.raises(ModelError, match="has what no .*weights in another file"):
        SmearNetwork(tmp_path / "a.onnx")


def test_integers_are_read_packed_or_not_and_as_wide_as_protobuf_reads_them() -> None:
    def found(attribute: bytes) -> set[str]:
        node = b"\x2a" + bytes([len(attribute)]) + attribute
        graph = b"\x0a" + bytes([len(node)]) + node
        return operators(b"\x3a" + bytes([len(graph)]) + graph)

    assert found(b"\x40\x21") == found(b"\x42\x02\x01\x21") == {"an integer of 33"}
    assert found(b"\x40" + b"\xff" * 9 + b"\x01") == set()  # -1
    assert found(b"\x40\xa1" + b"\x80" * 8 + b"\x7e") == {"an integer of 33"}  # beyond 64 bits
    assert found(b"\x22" + b"\x01\x21") == found(b"\x18\x20") == set()  # a text; 32
    with pytest.raises(ValueError, match="expected a message, got 33"):
        operators(b"\x38\x21")


def test_too_many_nodes_are_refused() -> None:
    node = helper.make_node("Abs", ["grey"], ["y"])
    for count, extra in ((MAX_NODES, set()), (MAX_NODES + 1, {f"{MAX_NODES + 1} nodes"})):
        graph = onnx.GraphProto(node=[node] * count)
        assert operators(onnx.ModelProto(graph=graph).SerializeToString()) == {"Abs"} | extra


def test_a_network_gets_no_more_memory_than_its_bound(tmp_path: Path) -> None:
    nodes = helper.make_node("Expand", ["one", "many"], ["costly"])
    model = computing(nodes, one=np.ones(1, np.float32), many=np.array([1 << 20, 1 << 20]))
    onnx.save(model, tmp_path / "a.onnx")
    network = SmearNetwork(tmp_path / "a.onnx")  # which computes nothing yet
    with pytest.raises(ModelError, match="cannot be run on 64x64"):
        network.predict(noise())


def test_a_network_that_computes_for_too_long_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    twice = [helper.make_node("MatMul", [f"m{k}", f"m{k}"], [f"m{k + 1}"]) for k in range(2000)]
    twice[-1].output[:] = ["costly"]
    onnx.save(computing(*twice, m0=np.eye(1000, dtype=np.float32)), tmp_path / "a.onnx")
    monkeypatch.setattr(model_file, "PATIENCE_S", 0.05)
    network = SmearNetwork(tmp_path / "a.onnx")
    with pytest.raises(ModelError, match="takes too long on 64x64"):
        network.predict(noise())


def test_a_network_is_run_deterministically(tiny_model: Path) -> None:
    assert open_session(tiny_model, 1).get_session_options().use_deterministic_compute
