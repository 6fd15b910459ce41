"""How a tool runs: its command line, its worker processes, and the page in Markdown that it writes.

The command line is read from the signature of the tool's `main`; a wrong path ends the tool at once.
"""

import argparse
import inspect
import multiprocessing
import os
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import cv2

T = TypeVar("T")
R = TypeVar("R")
THREAD_COUNTS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
MADE, END = "<!-- made -->\n", "<!-- end -->"


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


def mapped(work: Callable[[T], R], items: Iterable[T], processes: int, chunk: int = 1) -> Iterator[R]:
    """Yield the results of all items in order, by ``processes`` processes of one thread each, or by this one.

    Libraries read their limits when they are loaded, so the environment is set, and stays so.
    """
    if processes == 1:
        yield from map(work, items)
        return
    os.environ.update(dict.fromkeys(THREAD_COUNTS, "1"))
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, fresh, cv2.setNumThreads, (1,)) as pool:
        yield from pool.map(work, items, chunksize=chunk)


def table(head: str, rows: Iterable[Iterable[object]]) -> list[str]:
    """Return a table in Markdown as lines; the head's cells have a bar between them."""
    lines = [f"| {' | '.join(map(str, cells))} |" for cells in rows]
    return [f"| {head} |", "|---" * (head.count("|") + 1) + "|", *lines]


def publish(out: Path | None, *blocks: str | Iterable[str]) -> None:
    """Print blocks, each a text or lines, and the command that made them; write them where a path is given.

    A page that has the marks `MADE` and `END` keeps the words around them, which are by hand.
    """
    name = getattr(sys.modules["__main__"].__spec__, "name", Path(sys.argv[0]).name)
    made = f"Made by `python -m {name} {shlex.join(sys.argv[1:])}`."
    text = "\n\n".join(one if isinstance(one, str) else "\n".join(one) for one in (*blocks, made)) + "\n"
    print(text)
    if out is not None:
        before, mark, rest = (out.read_text() if out.exists() else "").partition(MADE)
        end, after = rest.partition(END)[1:]
        out.write_text(before + mark + text + end + after if end else text)
