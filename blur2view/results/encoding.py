"""Results in JSON's types, and back: what is read is built by the types of our own fields.

A file names no type, no function and no module, so that nothing in it is called.
"""

import base64
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np


def encode(value: Any) -> Any:
    """Return dataclasses, enums, paths, arrays and containers of these in JSON's types."""
    if isinstance(value, Enum):
        return value.value
    if is_dataclass(value):
        return {field.name: encode(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, np.ndarray):
        data = base64.b85encode(np.ascontiguousarray(value).tobytes()).decode()
        return {"shape": list(value.shape), "dtype": value.dtype.str, "data": data}
    if isinstance(value, Mapping):
        return {str(key): encode(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [encode(one) for one in value]
    if isinstance(value, np.generic):
        return value.item()
    return str(value) if isinstance(value, Path) else value


def decode(kind: Any, stored: Any) -> Any:
    """Return the object of a type that `encode` made a value of.

    The type is a dataclass, an enum, NDArray, a list, tuple or dict of these, str, int, float or bool, or one
    of them or None.
    """
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        (other,) = (one for one in arguments if one is not NoneType)
        return None if stored is None else decode(other, stored)
    if origin is np.ndarray:
        data = np.frombuffer(base64.b85decode(stored["data"]), stored["dtype"])
        return data.reshape(stored["shape"]).copy()  # which can be written
    if origin is tuple:
        kinds = arguments[:1] * len(stored) if arguments[-1] is Ellipsis else arguments
        return tuple(decode(own, one) for own, one in zip(kinds, stored, strict=True))
    if is_dataclass(kind):
        make: Any = kind
        return make(**{name: decode(hint, stored[name]) for name, hint in get_type_hints(kind).items()})
    return kind(stored) if isinstance(kind, type) and issubclass(kind, Enum) else stored
