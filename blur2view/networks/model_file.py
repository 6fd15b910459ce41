"""Files of networks: found, checked, opened and run by ONNX Runtime, beside one thread of other libraries."""

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import ContextDecorator
from dataclasses import dataclass, field
from functools import cache, wraps
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar

import cv2
import numpy as np
from threadpoolctl import ThreadpoolController

from blur2view.arrays import AnyArray
from blur2view.errors import ModelError
from blur2view.files import read_regular

INSTALL_AGAIN = "install blur2view again"
MAX_FILE_BYTES = 1 << 28  # bound: the shipped networks have at most 10 MB
BYTES_A_CORE = 1 << 29  # bound of their memory: a piece of a photograph takes half of it
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class NetworkFormat:
    """A kind of network: its file in ``models/``, its ``blur2view_format``, float32 inputs and outputs."""

    file: str
    version: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    what: str = "a mover network"
    remedy: str = INSTALL_AGAIN  # of a file that is not the shipped one


SMEAR = NetworkFormat(
    file="smear.onnx",
    what="a smear network",
    version="4",
    inputs=("grey", "cepstra", "scales", "coarser"),
    outputs=("logits", "radii", "kinds", "features"),
    remedy="export a network with tools/training/export.py, or omit the model to use the one that comes with "
    "blur2view",
)
"""Of one octave: grey (1, 1, H, W), cepstra (1, h, w, 32, 45), scales (1, h, w, 3), coarser (1, h, w, 32, C);
logits (1, h, w, 32, 20), radii (1, h, w, 20), kinds (1, h, w, 5) and features (1, h, w, 32, C)."""
UNET = NetworkFormat(
    file="unet.onnx", version="unet-1", inputs=("image", "cells"), outputs=("log_odds", "camera_moved")
)
"""Image (1, 3, 32 h, 32 w), cells (1, 70, h, w); log_odds (1, 8 h, 8 w), camera_moved (1,)."""
MOVERS = NetworkFormat(
    file="movers.onnx", version="movers-2", inputs=("blocks", "cells"), outputs=("log_odds",)
)
"""Blocks (1, 15, 8 h, 8 w), cells (1, 16, h, w); log_odds (1, 8 h, 8 w)."""


def model_path(name: str | os.PathLike[str] | None) -> Path:
    """Return the file of a smear network: the shipped one for None or "default", or the path itself."""
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
    """Threads of the networks, on which results do not depend, and providers of ONNX Runtime."""

    threads: int = field(default_factory=usable_cores)
    providers: tuple[str, ...] = ()


class OneThread(ContextDecorator):
    """Limits BLAS and OpenCV to one thread in a block: beside theirs, networks take 3 times as long."""

    def __init__(self) -> None:
        self._lock, self._inside = Lock(), 0
        self._imported, self._libraries = 0, list[Any]()

    def __enter__(self) -> None:
        """Note the limits and set them to one."""
        with self._lock:
            if not self._inside:
                self._of_opencv = cv2.getNumThreads()
                cv2.setNumThreads(1)
                if self._imported != len(sys.modules):  # to list the libraries of a process takes 1 ms
                    self._imported = len(sys.modules)
                    self._libraries = ThreadpoolController().select(user_api="blas").lib_controllers
                self._of_blas = [(library, library.num_threads) for library in self._libraries]
                for library, _ in self._of_blas:
                    _set_threads(library, 1)
            self._inside += 1

    def __exit__(self, *error: object) -> None:
        """Restore the limits when the last block ends."""
        with self._lock:
            self._inside -= 1
            if not self._inside:
                for library, count in self._of_blas:
                    _set_threads(library, count)
                cv2.setNumThreads(self._of_opencv)


def _set_threads(library: Any, count: int) -> None:
    """Set the threads of a library of threadpoolctl, whichever thread asks.

    Version 3.8 obeys only the thread that set a limit first, for as long as it lives: then a pool's worker,
    after an estimate in the main thread, would compute with all cores, and sums have other bytes.
    """
    if hasattr(library, "clear_controlling_thread"):
        library.clear_controlling_thread(force=True)
    library.set_num_threads(count)
    if hasattr(library, "clear_controlling_thread"):
        library.clear_controlling_thread(force=True)


one_thread = OneThread()


class OnnxNetwork:
    """A network of a format, shipped or in a file, opened by ONNX Runtime.

    ModelError if the file is not a network of the format. All networks of a process share `BYTES_A_CORE` for
    each core.
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
        provider_names = _provider_names(self.execution.providers)
        try:
            self.session = _session(content, self.execution.threads, provider_names)
            self.metadata: dict[str, str] = self.session.get_modelmeta().custom_metadata_map
        except Exception:  # ONNX Runtime has a dozen types; UnicodeDecodeError of a damaged name
            raise self.error("is not an ONNX network that can be run") from None
        if idle := [name for name in provider_names if name not in self.session.get_providers()]:
            raise ModelError(
                f"{_short(idle[0])} does not start, because its library or device is missing; omit it"
            )
        stated_format = self.metadata.get("blur2view_format", "none")
        if stated_format != form.version:
            raise self.error(f"is not {form.what} of format {form.version}; its format is {stated_format}")
        self.model_id: str = self.metadata.get("model_id", "unnamed")

    def error(self, what: str) -> ModelError:
        """Return an error that names the file, the defect and the remedy."""
        is_shipped = self.path == shipped_file(self.form.file)
        return ModelError(f"{self.path}: {what}; {INSTALL_AGAIN if is_shipped else self.form.remedy}")

    def run(self, *inputs: AnyArray, frugal: bool = False) -> list[AnyArray]:
        """Return all outputs for inputs, both without the batch axis; ``frugal`` frees the memory."""
        options = _onnxruntime().RunOptions()
        if frugal:
            options.add_run_config_entry("memory.enable_memory_arena_shrinkage", "cpu:0")
        feed = {name: array[None] for name, array in zip(self.form.inputs, inputs, strict=True)}
        try:
            outputs: list[AnyArray] = self.session.run(None, feed, options)
        except Exception:  # of the same types
            height, width = inputs[0].shape[-2:]
            raise self.error(f"cannot be run on {width}x{height} values") from None
        if not all(np.isfinite(output).all() for output in outputs):
            raise self.error("returns values that are not finite")
        return [output[0] for output in outputs]


def once(function: Callable[..., T]) -> Callable[..., T]:
    """Call a function once for arguments that are written alike, also where several threads ask."""
    lock, known = Lock(), cache(function)

    @wraps(function)
    def result(*words: Any, **named: Any) -> T:
        with lock:
            return known(*words, **named)

    return result


def shipped(form: NetworkFormat, execution: Execution) -> OnnxNetwork:
    """Return the shipped network of a format, opened once."""
    return _opened(form, shipped_file(form.file), execution)


@once
def _opened(form: NetworkFormat, path: Path, execution: Execution) -> OnnxNetwork:
    return OnnxNetwork(form, path, execution)


def _session(content: bytes, threads: int, providers: Sequence[str]) -> Any:
    """Return ONNX Runtime's session of a file's content."""
    options = _onnxruntime().SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.use_deterministic_compute = True
    options.add_session_config_entry(
        "session.intra_op.allow_spinning", "0"
    )  # waiting threads would take cores
    options.add_session_config_entry("session.use_env_allocators", "1")
    options.log_severity_level = 4  # fatal errors only: the exception has the rest
    return _onnxruntime().InferenceSession(
        content,
        options,
        providers=[*providers, "CPUExecutionProvider"],
        enable_fallback=0,  # with it ONNX Runtime would print to stdout and try once more
        disabled_optimizers=["ConstantFolding"],  # which would run parts of it, without bounds
    )


def _provider_names(providers: Sequence[str]) -> list[str]:
    """Return ONNX Runtime's names of execution providers; ModelError if its build lacks one."""
    if not providers:
        return []
    there = {_short(name): name for name in _onnxruntime().get_available_providers()}
    if missing := [name for name in providers if _short(name) not in there]:
        raise ModelError(
            f"{missing[0]}: is not an execution provider of this ONNX Runtime, which has {', '.join(there)}"
            "; cuda comes with onnxruntime-gpu in its place"
        )
    return [there[_short(name)] for name in providers if _short(name) != "cpu"]


def _short(provider: str) -> str:
    return provider.lower().removesuffix("executionprovider")


@once
def _onnxruntime() -> Any:
    """Return ONNX Runtime, imported so that it sends nothing to its vendor and writes nothing into HOME."""
    # read on import; disable_telemetry_events() comes too late: the device has its id by then (1.31)
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime  # slow to import, and needed only where a network runs

    max_bytes = BYTES_A_CORE * max(usable_cores(), 2)
    cpu = onnxruntime.OrtMemoryInfo(
        "Cpu", onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, onnxruntime.OrtMemType.DEFAULT
    )
    arena = onnxruntime.OrtArenaCfg({"max_mem": max_bytes, "arena_extend_strategy": 1})
    onnxruntime.create_and_register_allocator(cpu, arena)
    return onnxruntime
