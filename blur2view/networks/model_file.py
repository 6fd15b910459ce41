"""Files of networks: found, opened, and those of smear networks checked before anything runs."""

import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from blur2view.errors import ModelError
from blur2view.input_files import read_regular

_Nodes = list[tuple[str, str, int, int | None]]  # name, type, axes, channels where the file fixes them
FORMATS: dict[str, tuple[_Nodes, list[_Nodes], str]] = {
    "1": (
        [("image", "tensor(float)", 4, 3)],
        [[("smear", "tensor(float)", 4, channels)] for channels in (3, 4)],
        "image (N, 3, H, W) and smear (N, 3 or 4, h, w)",
    ),
    "2": (
        [("grey", "tensor(float)", 4, 1), ("coarser", "tensor(float)", 5, None)],
        [[("logits", "tensor(float)", 5, None), ("features", "tensor(float)", 5, None)]],
        "grey (1, 1, H, W), coarser (1, h, w, 32, C), logits (1, h, w, 32, B) and features (1, h, w, 32, C)",
    ),
}
"""Inputs, outputs, both in words: of a network that gives smears, of one that reads likelihoods."""
SHIPPED = {"default": "smear.onnx"}
MOST_PX = 1024  # photographs are padded to a multiple of this at most
REMEDY = "export one with tools/training/export_reader.py or leave the model out to use the shipped one"


@dataclass(frozen=True, kw_only=True)
class ModelInfo:
    """What a network file says of itself.

    Parameters
    ----------
    model_id : str
        Name of the weights.
    stride : int
        Pixels per cell of the output; cell j's centre is at pixel stride*j + (stride-1)/2.
    multiple_of : int
        Height and width of the input must be multiples of this.
    format : str
        "1": the network gives a smear per cell; "2": it reads the likelihood of smears in one octave of a
        photograph.
    channels : int
        Of the field: the double angle's x and y, sigma in pixels and, if four, sigma of the direction in
        radians.
    license : str
        Licence of the weights.
    training : dict
        How they were trained and what was measured, as written by ``tools/training/export_reader.py``.
    """

    model_id: str
    stride: int
    multiple_of: int
    format: str = "1"
    channels: int = 3
    license: str = ""
    training: dict[str, Any] = field(default_factory=dict)


def model_path(name: str | os.PathLike[str] | None) -> Path:
    """Return the file of a network: the shipped one for None or "default", or the path itself.

    A file of that name is named with its folder, ``./default``.
    """
    name = "default" if name is None else name
    if not isinstance(name, str) or name not in SHIPPED:
        return Path(name)
    return shipped_file(SHIPPED[name])


def shipped_file(name: str) -> Path:
    """Return a file of ``models/``: inside the installed package, or of a source checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "models" / name
    return installed if installed.exists() else package.parent / "models" / name


def open_session(path: Path, threads: int, remedy: str = REMEDY) -> Any:
    """Open an ONNX Runtime session or raise ModelError, which names the remedy."""
    onnxruntime = _onnxruntime()
    try:
        content = read_regular(path)
    except OSError as error:
        raise ModelError(f"{path}: cannot read the network ({error.strerror}); {remedy}") from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    options.log_severity_level = 4  # only what is fatal: the exception says the rest
    try:
        # with its fallback ONNX Runtime would print to stdout and try once more
        return onnxruntime.InferenceSession(
            content, options, providers=["CPUExecutionProvider"], enable_fallback=0
        )
    except session_errors():
        raise ModelError(f"{path}: is not an ONNX network that can be run; {remedy}") from None


def _onnxruntime() -> Any:
    """Return ONNX Runtime, imported so that it sends nothing to its vendor and writes nothing into HOME."""
    # read on import; disable_telemetry_events() comes too late: the device has its id by then (1.31)
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime  # 0.2 s, so only when a network is used

    return onnxruntime


def usable_cores() -> int:
    """Count the cores this process may use, which in a container can be fewer than the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def session_errors() -> tuple[type[Exception], ...]:
    """Return what ONNX Runtime raises; UnicodeDecodeError where a name in the file is damaged."""
    from onnxruntime.capi import onnxruntime_pybind11_state as errors

    return (
        UnicodeDecodeError,
        errors.Fail,
        errors.InvalidArgument,
        errors.InvalidGraph,
        errors.InvalidProtobuf,
        errors.NoModel,
        errors.NotImplemented,
        errors.RuntimeException,
    )


def read_info(path: Path, session: Any) -> ModelInfo:
    """Return the metadata of a network of our format; refuse any other."""
    try:
        metadata: dict[str, str] = session.get_modelmeta().custom_metadata_map
        inputs, outputs = (
            [(n.name, n.type, len(n.shape), _fixed(n.shape)) for n in nodes]
            for nodes in (session.get_inputs(), session.get_outputs())
        )
    except UnicodeDecodeError:
        raise ModelError(f"{path}: has damaged metadata (names that are no text); {REMEDY}") from None
    kind = metadata.get("blur2view_format", "")
    if kind not in FORMATS:
        formats = " or ".join(FORMATS)
        raise ModelError(f"{path}: is not a blur2view smear network of format {formats}; {REMEDY}")
    expected_inputs, possible_outputs, words = FORMATS[kind]
    if inputs != expected_inputs or outputs not in possible_outputs:
        raise ModelError(f"{path}: has other inputs or outputs than {words}; {REMEDY}")
    try:
        info = ModelInfo(
            model_id=metadata["model_id"],
            stride=int(metadata["stride"]),
            multiple_of=int(metadata["multiple_of"]),
            format=kind,
            channels=int(outputs[0][3] or 4),
            license=metadata.get("license", ""),
            training=json.loads(metadata.get("training", "{}")),
        )
    except (KeyError, ValueError, RecursionError) as error:
        raise ModelError(f"{path}: has damaged metadata ({error}); {REMEDY}") from None
    if not 1 <= info.stride <= info.multiple_of <= MOST_PX or info.multiple_of % info.stride:
        raise ModelError(f"{path}: has damaged metadata (stride, multiple_of); {REMEDY}")
    return info


def _fixed(shape: list[Any]) -> int | None:
    """Return the size of the second axis, the channels, if the file fixes it."""
    return shape[1] if len(shape) > 1 and isinstance(shape[1], int) else None
