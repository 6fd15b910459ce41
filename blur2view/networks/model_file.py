"""Files of networks: found, checked, opened and run by ONNX Runtime."""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.errors import ModelError
from blur2view.input_files import read_regular

CPU = "CPUExecutionProvider"
MAX_FILE_BYTES = 1 << 28  # the shipped networks have 10 MB at most
BYTES_A_CORE = 1 << 29  # of what networks compute; a tile takes half of it


@dataclass(frozen=True, kw_only=True)
class NetworkFormat:
    """A kind of network: the file of ``models/`` that ships, and what its files hold.

    Parameters
    ----------
    file, what, version : str
        Name of the shipped file, what it is called in errors, and its ``blur2view_format``.
    inputs, outputs : tuple of str
        Names, all of float32.
    remedy : str
        What a user can do about a file that is not one.
    """

    file: str
    what: str
    version: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    remedy: str = "install blur2view again"


SMEAR = NetworkFormat(
    file="smear.onnx",
    what="a smear network",
    version="4",
    inputs=("grey", "cepstra", "scales", "coarser"),
    outputs=("logits", "radii", "kinds", "features"),
    remedy="export one with tools/training/export.py or leave the model out to use the shipped one",
)
"""Of one octave: grey (1, 1, H, W), cepstra (1, h, w, 32, 45), scales (1, h, w, 3), coarser (1, h, w, 32, C);
logits (1, h, w, 32, 20), radii (1, h, w, 20), kinds (1, h, w, 5) and features (1, h, w, 32, C)."""
UNET = NetworkFormat(
    file="unet.onnx",
    what="a mover network",
    version="unet-1",
    inputs=("image", "cells"),
    outputs=("log_odds", "camera_moved"),
)
"""Image (1, 3, 32 h, 32 w), cells (1, 70, h, w); log_odds (1, 8 h, 8 w), camera_moved (1,)."""
BLUR = NetworkFormat(
    file="movers.onnx",
    what="a mover network",
    version="movers-1",
    inputs=("places", "cells"),
    outputs=("log_odds",),
)
"""Places (1, 15, 8 h, 8 w), cells (1, 19, h, w); log_odds (1, 2, 8 h, 8 w)."""


@dataclass(frozen=True, kw_only=True)
class ModelInfo:
    """What a smear network's file says of itself.

    Parameters
    ----------
    model_id : str
        Name of the weights.
    features : int
        Numbers per cell and direction that one octave hands to the next larger one.
    brightness : float
        What darker photographs are brightened to before they are read, as in training (see
        `blur2view.networks.smear_network.gain_of`); 0: they are read as they are.
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
    """Return the file of a smear network: the shipped one for None or "default", or the path itself.

    A file of that name is named with its folder, ``./default``.
    """
    return shipped_file(SMEAR.file) if name is None or name == "default" else Path(name)


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
    """A network of a format, opened by ONNX Runtime.

    All networks of the process together get no more memory than `BYTES_A_CORE` for each core.

    Parameters
    ----------
    form : NetworkFormat
    path : Path, optional
        The shipped file by default.
    execution : Execution, optional
        What runs it; the processor by default.

    Raises
    ------
    ModelError
        If the file cannot be read or is no network of the format, or there is no such provider; it names the
        remedy.
    """

    def __init__(
        self, form: NetworkFormat, path: Path | None = None, execution: Execution | None = None
    ) -> None:
        self.form, self.path = form, path or shipped_file(form.file)
        self.execution = execution or Execution()
        try:
            content = read_regular(self.path, MAX_FILE_BYTES)
        except OSError as error:
            raise self.error(f"cannot read the network ({error.strerror})") from None
        wanted = _provider_names(self.execution.providers)
        options = _onnxruntime().SessionOptions()
        options.intra_op_num_threads = self.execution.threads
        options.inter_op_num_threads = 1
        options.use_deterministic_compute = True
        options.add_session_config_entry("session.force_spinning_stop", "1")  # or idle threads take a core
        options.add_session_config_entry("session.use_env_allocators", "1")
        options.log_severity_level = 4  # only what is fatal: the exception says the rest
        try:
            # with its fallback ONNX Runtime would print to stdout and try once more
            self.session = _onnxruntime().InferenceSession(
                content,
                options,
                providers=[*wanted, CPU],
                enable_fallback=0,
                disabled_optimizers=["ConstantFolding"],  # which would run parts of it, without bounds
            )
        except Exception:  # of a dozen types of its own, and UnicodeDecodeError of a damaged name
            raise self.error("is not an ONNX network that can be run") from None
        if idle := [name for name in wanted if name not in self.session.get_providers()]:
            missing = f"{_short(idle[0])} does not start: a library or a device is missing"
            raise ModelError(f"{missing}; leave it out")
        self.metadata = self._checked_metadata()
        self.model_id = self.metadata["model_id"]

    def error(self, what: str) -> ModelError:
        """Return the error that names the file, what is wrong and the remedy."""
        return ModelError(f"{self.path}: {what}; {self.form.remedy}")

    def _checked_metadata(self) -> dict[str, str]:
        try:
            metadata: dict[str, str] = self.session.get_modelmeta().custom_metadata_map
        except ValueError as error:  # of a name that is no text
            raise self.error(f"has damaged metadata ({error})") from None
        stated = metadata.get("blur2view_format", "")
        if stated != self.form.version:
            other = f"but of {stated}" if stated else "as it states no blur2view_format"
            raise self.error(f"is not {self.form.what} of format {self.form.version}, {other}")
        if "model_id" not in metadata:
            raise self.error("has damaged metadata (no model_id)")
        return metadata

    def info(self) -> ModelInfo:
        """Return what a smear network's file says of itself; ModelError if that is damaged."""
        metadata = self.metadata
        try:
            shapes = {node.name: node.shape for node in self.session.get_inputs()}
            return ModelInfo(
                model_id=self.model_id,
                features=int(shapes[SMEAR.inputs[-1]][-1]),
                brightness=float(metadata.get("brightness", "0")),
                license=metadata.get("license", ""),
                training=json.loads(metadata.get("training", "{}")),
            )
        except (KeyError, ValueError, RecursionError) as error:
            raise self.error(f"has damaged metadata ({error})") from None

    def run(self, *inputs: AnyArray, frugal: bool = False) -> list[AnyArray]:
        """Return all outputs for the inputs, in order, without the first axis of both.

        A ``frugal`` run gives its memory back, which the next has to take anew.

        Raises
        ------
        ModelError
            If the network cannot be run on them, or what it gives is not finite.
        """
        options = _onnxruntime().RunOptions()
        if frugal:
            options.add_run_config_entry("memory.enable_memory_arena_shrinkage", "cpu:0")
        given = {name: one[None] for name, one in zip(self.form.inputs, inputs, strict=True)}
        try:
            outputs: list[AnyArray] = self.session.run(None, given, options)
        except Exception:  # of the same types
            height, width = inputs[0].shape[-2:]
            raise self.error(f"cannot be run on {width}x{height} values") from None
        if not all(np.isfinite(output).all() for output in outputs):
            raise self.error("gives values that are not finite")
        return [output[0] for output in outputs]


@cache
def shipped(form: NetworkFormat, execution: Execution) -> OnnxNetwork:
    """Return the network of a format that ships."""
    return OnnxNetwork(form, execution=execution)


def _provider_names(providers: Sequence[str]) -> list[str]:
    """Return ONNX Runtime's names of execution providers; ModelError if its build lacks one."""
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
