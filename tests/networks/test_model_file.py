"""The network's file: what it says of itself, and what is refused in one line."""

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from types import ModuleType
from unittest.mock import Mock

import cv2
import numpy as np
import onnx
import pytest
from threadpoolctl import ThreadpoolController, threadpool_info

from blur2view.errors import ModelError
from blur2view.networks import model_file
from blur2view.networks.model_file import (
    MOVERS,
    UNET,
    Execution,
    NetworkFormat,
    OneThread,
    OnnxNetwork,
    model_path,
    once,
    one_thread,
    shipped,
)
from blur2view.networks.smear_network import SmearNetwork
from tests.support.colour_code import colour_code_network, noise


def test_network_tells_what_it_is_and_the_shipped_one_is_found_in_the_source_tree(tiny_model: Path) -> None:
    info = SmearNetwork(tiny_model).info
    assert info["model_id"] == "colour-code" and info["training"] == '{"seed": 0}'
    models = Path(__file__).resolve().parents[2] / "models"
    assert model_path(None) == model_path("default") == models / "smear.onnx"
    assert model_path("./default") == Path("default")


def test_provider_that_onnx_runtime_lacks_is_named_in_one_line(tiny_model: Path) -> None:
    with pytest.raises(ModelError, match="rocket: is not an execution provider of this ONNX Runtime, .*cpu"):
        SmearNetwork(tiny_model, providers=["rocket"])
    found = SmearNetwork(tiny_model, providers=["cpu"]).predict(noise())
    np.testing.assert_array_equal(found.cells, SmearNetwork(tiny_model).predict(noise()).cells)


def test_the_shipped_network_is_installed_again_where_another_one_is_omitted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    damaged = tmp_path / "smear.onnx"
    damaged.write_bytes(b"cut")
    with pytest.raises(ModelError, match="omit the model"):
        SmearNetwork(damaged)
    SmearNetwork()  # opened before, as in any process that has read a photograph
    monkeypatch.setattr("blur2view.networks.model_file.shipped_file", lambda name: tmp_path / name)
    with pytest.raises(ModelError, match="is not an ONNX network that can be run; install blur2view again"):
        SmearNetwork(damaged)


@pytest.mark.parametrize("form", [UNET, MOVERS], ids=lambda form: form.file)
def test_mover_networks_say_what_they_are_and_another_file_is_refused(
    form: NetworkFormat, tmp_path: Path
) -> None:
    assert shipped(form, Execution()).model_id.startswith(form.version.partition("-")[0])
    onnx.save(colour_code_network(), tmp_path / "other.onnx")
    with pytest.raises(ModelError, match=f"is not a mover network of format {form.version}; its format is 4"):
        OnnxNetwork(form, tmp_path / "other.onnx")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot read the network"),
        (b"not a network", "not an ONNX network"),
        (colour_code_network().SerializeToString()[:200], "not an ONNX network"),
        (colour_code_network().SerializeToString().replace(b"CC0", b"CC\xff"), "not an ONNX network"),
        (
            colour_code_network(blur2view_format="5").SerializeToString(),
            "is not .* of format 4; its format is 5",
        ),
        (colour_code_network(brightness="[").SerializeToString(), "damaged metadata"),
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


def test_onnx_runtime_sends_nothing_and_writes_nothing(tiny_model: Path, tmp_path: Path) -> None:
    code = "import sys; from blur2view.networks.smear_network import SmearNetwork; SmearNetwork(sys.argv[1])"
    hidden = ("ORT_DISABLE_TELEMETRY", "XDG_CACHE_HOME")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    environment |= {"HOME": str(tmp_path), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    subprocess.run([sys.executable, "-c", code, tiny_model], env=environment, check=True)
    assert list(tmp_path.rglob("*")) == []  # its device id and what it sends lie there


def threads() -> list[int]:
    """Return how many threads OpenCV and BLAS use."""
    return [
        cv2.getNumThreads(),
        *(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"),
    ]


def test_threads_are_as_before_after_the_outermost_block_and_after_an_error() -> None:
    before = threads()
    with pytest.raises(KeyError), one_thread:
        with one_thread:
            pass
        assert set(threads()) == {1}
        raise KeyError
    assert threads() == before


def test_libraries_are_listed_anew_only_once_something_was_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    block, listed = OneThread(), Mock(wraps=ThreadpoolController)
    monkeypatch.setattr(model_file, "ThreadpoolController", listed)
    for imported in (0, 0, 1, 0):
        if imported:
            monkeypatch.setitem(sys.modules, "made_up", ModuleType("made_up"))
        with block:
            assert set(threads()) == {1}
    assert listed.call_count == 2


def test_two_threads_that_ask_at_once_share_one_result() -> None:
    asked, both = list[int](), Barrier(2)

    @once
    def made(number: int) -> object:
        asked.append(number)
        time.sleep(0.05)
        return object()

    def ask(number: int) -> object:
        both.wait()
        return made(number)

    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(ask, [1, 1])
    assert first is second and asked == [1]
    assert made(number=2) is made(number=2)
