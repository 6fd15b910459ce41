"""Development tools of blur2view: rendering, training, export, evaluation, benchmarks.

They import :mod:`blur2view`; the package never imports them. Many need a library of an extra: where it is
missing, a tool ends with one line that names the extra.
"""

import sys
from types import TracebackType

EXTRA_OF = {  # a module that tools import: what to install
    "onnx": "train",
    "pillow_heif": "test",
    "playwright": "test",
    "poselib": "train",
    "skimage": "train",
    "torch": "train",
}


def _end(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print one line about a module of an extra that is not installed, anything else as Python does."""
    name = (getattr(error, "name", None) or "").partition(".")[0]
    if isinstance(error, ModuleNotFoundError) and name in EXTRA_OF:
        print(f"this needs {name}; install it with: pip install '.[{EXTRA_OF[name]}]'", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


sys.excepthook = _end  # before any tool is imported, as each imports its libraries first of all
