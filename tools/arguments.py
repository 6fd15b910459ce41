"""Command lines of tools, read from the signatures of their `main`; a wrong path ends a tool at once."""

import argparse
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints


def existing(text: str) -> Path:
    """Parse the path of an existing file or folder."""
    if not (path := Path(text)).exists():
        raise argparse.ArgumentTypeError(f"{text}: no such file or folder")
    return path


def target(text: str) -> Path:
    """Parse the path of a result, and make its folder."""
    path = Path(text)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{text}: {path.parent}: {error.strerror}") from None
    return path


Existing = Annotated[Path, existing]
Target = Annotated[Path, target]


def run(main: Callable[..., object]) -> None:
    """Call a tool's ``main`` with the values of the command line; the help is its module's docstring.

    A parameter is an argument or, if it is keyword-only, an option, required without a default.
    """
    text, raw = sys.modules[main.__module__].__doc__, argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=text, formatter_class=raw)
    hints = get_type_hints(main, include_extras=True)
    for name, parameter in inspect.signature(main).parameters.items():
        words, default = _words(hints[name]), parameter.default
        if parameter.kind is not parameter.KEYWORD_ONLY:
            parser.add_argument(name, **words)
        else:
            words |= {"required": True} if default is parameter.empty else {"default": default}
            shown = "" if default in (None, False, parameter.empty) else f"(default: {default})"
            parser.add_argument(f"--{name.replace('_', '-')}", help=shown, **words)
    given = vars(parser.parse_args())
    try:
        main(**{k: tuple(v) if get_origin(hints[k]) is tuple else v for k, v in given.items()})
    except ModuleNotFoundError as error:
        raise SystemExit(f"{error.name} is not installed; pip install '.[train,test]'") from None


def _words(hint: Any) -> dict[str, Any]:
    """Return the keyword arguments of ``add_argument`` for a type."""
    origin, of = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return {"type": of[1]}
    if origin in (Union, UnionType):
        return _words(next(one for one in of if one is not NoneType))
    if origin in (list, tuple):
        return _words(of[0]) | {"nargs": "+" if origin is list else len(of)}
    if origin is Literal:
        return {"choices": of}
    return {"action": "store_true"} if hint is bool else {"type": hint}
