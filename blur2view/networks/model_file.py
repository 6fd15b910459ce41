"""Files of networks: found, opened, and those of smear networks checked before anything runs."""

import json
import os
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from blur2view.arrays import AnyArray
from blur2view.errors import ModelError
from blur2view.input_files import read_regular
from blur2view.networks.spectra import STEP

FORMAT = "4"
INPUTS = "grey", "cepstra", "scales", "coarser"
OUTPUTS = "logits", "radii", "kinds", "features"
"""Of float32: grey (1, 1, H, W), cepstra (1, h, w, 32, 45), scales (1, h, w, 3), coarser (1, h, w, 32, C),
logits (1, h, w, 32, 20), radii (1, h, w, 20), kinds (1, h, w, 5) and features (1, h, w, 32, C)."""
SHIPPED = "smear.onnx"
CPU = "CPUExecutionProvider"
MAX_FILE_BYTES = 1 << 28  # the shipped networks have 10 MB at most
BYTES_A_CORE = 1 << 29  # of what networks compute; a tile takes half of it
PATIENCE_S, PATIENCE_S_A_CELL = 10.0, 0.1  # the shipped network takes a millisecond a cell
REMEDY = "export one with tools/training/export.py or leave the model out to use the shipped one"


@dataclass(frozen=True, kw_only=True)
class ModelInfo:
    """What a network file says of itself.

    Parameters
    ----------
    model_id : str
        Name of the weights.
    features : int
        Numbers per cell and direction that one octave hands to the next larger one.
    brightness : float
        What darker photographs are brightened to before they are read, as in training (see
        :mod:`blur2view.networks.brightness`); 0: they are read as they are.
    license : str
        Licence of the weights.
    training : dict
        How they were trained and what was measured, as written by ``tools/training/export.py``.
    """

    model_id: str
    features: int
    brightness: float = 0.0
    license: str = ""
    training: dict[str, Any] = field(default_factory=dict)


def model_path(name: str | os.PathLike[str] | None) -> Path:
    """Return the file of a network: the shipped one for None or "default", or the path itself.

    A file of that name is named with its folder, ``./default``.
    """
    return shipped_file(SHIPPED) if name is None or name == "default" else Path(name)


def shipped_file(name: str) -> Path:
    """Return a file of ``models/``: inside the installed package, or of a source checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "models" / name
    return installed if installed.exists() else package.parent / "models" / name


def usable_cores() -> int:
    """Count the cores this process may use, which in a container can be fewer than the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True, kw_only=True)
class Execution:
    """What runs networks: so many threads, on which the result does not depend, and ONNX Runtime's providers.

    These, such as cuda, coreml or openvino, are tried before the processor.
    """

    threads: int = field(default_factory=usable_cores)
    providers: tuple[str, ...] = ()


class OnnxNetwork:
    """A network that ONNX Runtime has opened.

    Nothing of it is run before it is asked to, and then within a bound on memory, `BYTES_A_CORE` of all
    networks of the process together, and on time.

    Raises
    ------
    ModelError
        If the file cannot be read or is no network, or there is no such provider; it names the remedy.
    """

    def __init__(self, path: Path, execution: Execution, remedy: str = REMEDY) -> None:
        self.path, self.execution, self.remedy = path, execution, remedy
        try:
            content = read_regular(path, MAX_FILE_BYTES)
        except OSError as error:
            raise ModelError(f"{path}: cannot read the network ({error.strerror}); {remedy}") from None
        onnxruntime = _onnxruntime()
        wanted = _provider_names(execution.providers)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = execution.threads
        options.inter_op_num_threads = 1
        options.use_deterministic_compute = True
        options.add_session_config_entry("session.force_spinning_stop", "1")  # or idle threads take a core
        options.add_session_config_entry("session.use_env_allocators", "1")
        options.log_severity_level = 4  # only what is fatal: the exception says the rest
        try:
            # with its fallback ONNX Runtime would print to stdout and try once more
            self.session = onnxruntime.InferenceSession(
                content,
                options,
                providers=[*wanted, CPU],
                enable_fallback=0,
                disabled_optimizers=["ConstantFolding"],  # which would run parts of it, without bounds
            )
        except Exception:  # of a dozen types of its own, and UnicodeDecodeError of a damaged name
            raise ModelError(f"{path}: is not an ONNX network that can be run; {remedy}") from None
        if idle := [name for name in wanted if name not in self.session.get_providers()]:
            missing = f"{_short(idle[0])} does not start: a library or a device is missing"
            raise ModelError(f"{missing}; leave it out")

    def run(
        self, inputs: dict[str, AnyArray], size: tuple[int, int], *, frugal: bool = False
    ) -> list[AnyArray]:
        """Return all outputs; ModelError if it cannot be run, or takes far longer than it should.

        ``size`` is width and height of the picture, pixels. The run ends at its next operator. A ``frugal``
        one gives its memory back, which the next has to take anew.
        """
        options = _onnxruntime().RunOptions()
        if frugal:
            options.add_run_config_entry("memory.enable_memory_arena_shrinkage", "cpu:0")
        cells = size[0] * size[1] // STEP**2
        timer = threading.Timer(PATIENCE_S + PATIENCE_S_A_CELL * cells, setattr, (options, "terminate", True))
        timer.daemon = True
        timer.start()
        try:
            outputs: list[AnyArray] = self.session.run(None, inputs, options)
        except Exception:  # of the same types, or that its time was over
            why = "takes too long" if options.terminate else "cannot be run"
            raise ModelError(f"{self.path}: {why} on {size[0]}x{size[1]} pixels; {self.remedy}") from None
        finally:
            timer.cancel()
        return outputs


def _provider_names(providers: Sequence[str]) -> list[str]:
    """Return ONNX Runtime's names of execution providers; ModelError if its build has one of them not."""
    there = {_short(name): name for name in _onnxruntime().get_available_providers()}
    for name in providers:
        if _short(name) not in there:
            known = ", ".join(there)
            raise ModelError(
                f"{name}: is no execution provider of this ONNX Runtime, which has {known}"
                "; cuda comes with onnxruntime-gpu in its place"
            )
    return [there[_short(name)] for name in providers if there[_short(name)] != CPU]


def _short(provider: str) -> str:
    return provider.lower().removesuffix("executionprovider")


@lru_cache
def _onnxruntime() -> Any:
    """Return ONNX Runtime, imported so that it sends nothing to its vendor and writes nothing into HOME.

    Sessions that use its common allocator get no more memory than `BYTES_A_CORE` for each core.
    """
    # read on import; disable_telemetry_events() comes too late: the device has its id by then (1.31)
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime  # 0.2 s, so only when a network is used

    most = BYTES_A_CORE * max(usable_cores(), 2)
    cpu = onnxruntime.OrtMemoryInfo(
        "Cpu", onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, onnxruntime.OrtMemType.DEFAULT
    )
    arena = onnxruntime.OrtArenaCfg({"max_mem": most, "arena_extend_strategy": 1})
    onnxruntime.create_and_register_allocator(cpu, arena)
    return onnxruntime


def metadata_of(network: OnnxNetwork, what: str, version: str) -> dict[str, str]:
    """Return the metadata of a network's file; ModelError unless it is ``what``, of this format."""
    path, remedy = network.path, network.remedy
    try:
        metadata: dict[str, str] = network.session.get_modelmeta().custom_metadata_map
    except ValueError as error:  # of a name that is no text
        raise ModelError(f"{path}: has damaged metadata ({error}); {remedy}") from None
    stated = metadata.get("blur2view_format", "")
    if stated != version:
        other = f"but of {stated}" if stated else "or of none"
        raise ModelError(f"{path}: is not {what} of format {version}, {other}; {remedy}")
    if "model_id" not in metadata:
        raise ModelError(f"{path}: has damaged metadata (no model_id); {remedy}")
    return metadata


def read_info(network: OnnxNetwork) -> ModelInfo:
    """Return what a smear network's file says of itself; ModelError of any other."""
    metadata = metadata_of(network, "a smear network", FORMAT)
    try:
        shapes = {node.name: node.shape for node in network.session.get_inputs()}
        return ModelInfo(
            model_id=metadata["model_id"],
            features=int(shapes[INPUTS[-1]][-1]),
            brightness=float(metadata.get("brightness", "0")),
            license=metadata.get("license", ""),
            training=json.loads(metadata.get("training", "{}")),
        )
    except (KeyError, ValueError, RecursionError) as error:
        raise ModelError(f"{network.path}: has damaged metadata ({error}); {network.remedy}") from None
