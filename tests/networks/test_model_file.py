"""The network's file: what it says of itself, and what is refused in one line."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import helper

from blur2view.errors import ModelError
from blur2view.networks import model_file
from blur2view.networks.model_file import (
    BLUR,
    UNET,
    Execution,
    NetworkFormat,
    OnnxNetwork,
    model_path,
    shipped,
)
from blur2view.networks.smear_network import SmearNetwork
from tests.support.colour_code import colour_code_network, noise


def test_network_tells_what_it_is(tiny_model: Path) -> None:
    info = SmearNetwork(tiny_model).info
    assert info.model_id == "colour-code"
    assert info.training == {"seed": 0}


def test_shipped_network_is_found_in_the_source_tree_and_others_by_their_path() -> None:
    models = Path(__file__).resolve().parents[2] / "models"
    assert model_path(None) == model_path("default") == models / "smear.onnx"
    assert model_path("./default") == model_path(Path("default")) == Path("default")
    assert model_path("fast") == Path("fast")


def test_provider_that_onnx_runtime_lacks_is_named_in_one_line(tiny_model: Path) -> None:
    with pytest.raises(ModelError, match="rocket: is no execution provider of this ONNX Runtime, .*cpu"):
        SmearNetwork(tiny_model, providers=["rocket"])
    for name in ("cpu", "CPUExecutionProvider"):
        image = noise()
        found = SmearNetwork(tiny_model, providers=[name]).predict(image)
        np.testing.assert_array_equal(found.cells, SmearNetwork(tiny_model).predict(image).cells)
    with pytest.raises(ModelError, match="rocket: is no execution provider"):
        OnnxNetwork(UNET, execution=Execution(providers=("rocket",)))


@pytest.mark.parametrize("form", [UNET, BLUR], ids=lambda form: form.file)
def test_mover_networks_say_what_they_are_and_another_file_is_refused(
    form: NetworkFormat, tmp_path: Path
) -> None:
    assert shipped(form, Execution()).model_id.startswith(form.version.partition("-")[0])
    onnx.save(colour_code_network(), tmp_path / "other.onnx")
    with pytest.raises(ModelError, match=f"is not a mover network of format {form.version}, but of 4"):
        OnnxNetwork(form, tmp_path / "other.onnx")


def any_features() -> onnx.ModelProto:
    """Return the tiny network without a fixed number of features."""
    model = colour_code_network()
    model.graph.input[3].type.tensor_type.shape.dim[4].dim_param = "C"
    return model


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot read the network"),
        (b"not a network", "not an ONNX network"),
        (colour_code_network().SerializeToString()[:200], "not an ONNX network"),
        (colour_code_network().SerializeToString().replace(b"Pool", b"Poo\xff"), "not an ONNX network"),
        (colour_code_network().SerializeToString().replace(b"CC0", b"CC\xff"), "damaged metadata"),
        (colour_code_network(blur2view_format="5").SerializeToString(), "is not .* of format 4, but of 5"),
        (any_features().SerializeToString(), "damaged metadata"),
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


def test_a_network_gets_no_more_memory_than_its_bound(tmp_path: Path) -> None:
    model, most = colour_code_network(), model_file.BYTES_A_CORE * max(model_file.usable_cores(), 2)
    next(node for node in model.graph.node if "logits" in node.output).output[:] = ["some"]
    costly = [
        helper.make_node("Expand", ["one", "many"], ["costly"]),
        helper.make_node("ReduceMean", ["costly"], ["mean"], keepdims=0),
        helper.make_node("Add", ["some", "mean"], ["logits"]),
    ]
    model.graph.node.extend([*costly, model.graph.node.pop()])
    constants = {"one": np.ones(1, np.float32), "many": np.array([most // 4096 + 1, 1024])}
    model.graph.initializer.extend(onnx.numpy_helper.from_array(a, name) for name, a in constants.items())
    onnx.save(model, tmp_path / "a.onnx")
    network = SmearNetwork(tmp_path / "a.onnx")  # which computes nothing yet
    with pytest.raises(ModelError, match="cannot be run on 64x64"):
        network.predict(noise())
