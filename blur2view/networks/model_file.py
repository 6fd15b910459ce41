"""Files of networks: found, opened, and those of smear networks checked before anything runs."""

import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.errors import ModelError

FORMAT = "1"
OUTPUTS = [("smear", "tensor(float)", 4, channels) for channels in (3, 4)]
SHIPPED = {"default": "smear_fast.onnx", "fast": "smear_fast.onnx", "float": "smear.onnx"}
REMEDY = "export one with tools/training/export_onnx.py or leave the model out to use the shipped one"


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
    channels : int
        Of the output: the double angle's x and y, sigma in pixels and, if four, sigma of the direction in
        radians.
    longest_px : float or None
        Length up to which smears are measured well; smaller copies of the image are looked at for longer
        ones. None if the file does not say: then there are no smaller copies.
    license : str
        Licence of the weights.
    training : dict
        How they were trained and what was measured, as written by ``tools/training/export_onnx.py``.
    """

    model_id: str
    stride: int
    multiple_of: int
    channels: int = 3
    longest_px: float | None = None
    license: str = ""
    training: dict[str, Any] = field(default_factory=dict)


def model_path(name: str | os.PathLike[str] | None) -> Path:
    """Return the file of a network: a shipped one by its name, or the path itself.

    None means "default", which is "fast": 8-bit integers, as good as "float" and twice as fast. A file that
    is called like one of these is named with its folder, ``./fast``.
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
    import onnxruntime  # 0.2 s, so only when a network is used

    try:
        content = path.read_bytes()
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
        signature = [
            (node.name, node.type, len(node.shape), node.shape[1] if len(node.shape) > 1 else None)
            for node in (*session.get_inputs(), *session.get_outputs())
        ]
    except UnicodeDecodeError:
        raise ModelError(f"{path}: has damaged metadata (names that are no text); {REMEDY}") from None
    if metadata.get("blur2view_format") != FORMAT:
        raise ModelError(f"{path}: is not a blur2view smear network of format {FORMAT}; {REMEDY}")
    image, *outputs = signature
    if image != ("image", "tensor(float)", 4, 3) or outputs not in [[output] for output in OUTPUTS]:
        raise ModelError(
            f"{path}: has other inputs or outputs than image (N, 3, H, W), smear (N, 3 or 4, H, W); {REMEDY}"
        )
    try:
        info = ModelInfo(
            model_id=metadata["model_id"],
            stride=int(metadata["stride"]),
            multiple_of=int(metadata["multiple_of"]),
            channels=int(outputs[0][3] or 0),
            longest_px=float(metadata["longest_px"]) if "longest_px" in metadata else None,
            license=metadata.get("license", ""),
            training=json.loads(metadata.get("training", "{}")),
        )
    except (KeyError, ValueError) as error:
        raise ModelError(f"{path}: has damaged metadata ({error}); {REMEDY}") from None
    if info.stride < 1 or info.multiple_of < 1 or info.multiple_of % info.stride:
        raise ModelError(f"{path}: has damaged metadata (stride, multiple_of); {REMEDY}")
    if info.longest_px is not None and not 0 < info.longest_px < np.inf:
        raise ModelError(f"{path}: has damaged metadata (longest_px); {REMEDY}")
    return info
