"""Results in JSON's types, and back: a file that anybody may have written gives values, and calls nothing.

What is read is built by the types of our own fields: a file names no type, no function and no module, and a
value of another type, a key too many or too few is a ValueError.
"""

import base64
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from blur2view.arrays import AnyArray

DAMAGE = (ValueError, TypeError, LookupError, ArithmeticError)
"""What constructors of ours raise for values of the right types that make no sense."""


def plain(value: Any) -> Any:
    """Return dataclasses, enums, paths, arrays and containers of these in JSON's types."""
    if isinstance(value, Enum):
        return value.value
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, np.ndarray):
        data = base64.b85encode(np.ascontiguousarray(value).tobytes()).decode()
        return {"shape": list(value.shape), "dtype": value.dtype.str, "data": data}
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if isinstance(value, np.generic):
        return value.item()
    return str(value) if isinstance(value, Path) else value


def restore(kind: Any, stored: Any) -> Any:
    """Return the object of a type that `plain` made a value of; ValueError if it cannot have been one.

    The type is a dataclass, an enum, NDArray, a list, tuple or dict of these, str, int, float or bool, or one
    of them or None.
    """
    origin, arguments = get_origin(kind), get_args(kind)
    if kind is Any:
        return stored
    if origin in (Union, UnionType):
        (other,) = (one for one in arguments if one is not NoneType)
        return None if stored is None else restore(other, stored)
    if origin is np.ndarray:
        return _array(get_args(arguments[1])[0], stored)
    if origin is list:
        return [restore(arguments[0], one) for one in _of(list, stored)]
    if origin is tuple:
        stored = _of(list, stored)
        kinds = arguments[:1] * len(stored) if arguments[-1] is Ellipsis else arguments
        return tuple(restore(own, one) for own, one in zip(kinds, stored, strict=True))
    if origin is dict:
        return {name: restore(arguments[1], one) for name, one in _of(dict, stored).items()}
    if not is_dataclass(kind):
        return kind(_of(str, stored)) if issubclass(kind, Enum) else _of(kind, stored)
    hints, stored, make = get_type_hints(kind), _of(dict, stored), cast(Any, kind)
    if hints.keys() != stored.keys():
        raise ValueError(f"expected the fields of {make.__name__}, got others")
    return make(**{name: restore(hint, stored[name]) for name, hint in hints.items()})


def _of(kind: type, stored: Any) -> Any:
    """Return a value that is of one of JSON's types; a number without fraction is a float, too."""
    exact = type(stored) is kind or (kind is float and type(stored) is int)
    if not exact or (type(stored) is int and abs(stored) >= 1 << 63) or stored in (math.inf, -math.inf):
        raise ValueError(f"expected a {kind.__name__}, got a {type(stored).__name__}")
    return stored


def _array(kind: type[np.generic], stored: Any) -> AnyArray:
    """Return an array of finite numbers, no larger than its text."""
    stored = _of(dict, stored)
    array = np.frombuffer(base64.b85decode(_of(str, stored.get("data"))), np.dtype(kind))
    if stored.get("dtype") != array.dtype.str or not np.isfinite(array).all():
        raise ValueError(f"expected finite numbers of type {kind.__name__}")
    shape = [_of(int, side) for side in _of(list, stored.get("shape"))]
    return array.reshape(shape).astype(kind)  # a copy that can be written
