"""An option of a command, declared once: as the field of a frozen dataclass, with its help below it.

The parser, both helps, the completion of a shell, the errors and what a command reads come from that field. A
command has its own options and those of its base classes; one that it declares anew without `option` is not
offered.
"""

from argparse import BooleanOptionalAction
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar, get_args

from blur2view.cli.arguments.values import file_path, whole
from blur2view.results.document import Document, explained

Rows = str | type[Document] | Mapping[str, str]
"""A table of the help: lines as "name: explanation", further ones indented, or a document's keys."""
INPUT, OUTPUT, VIEWS = "input", "output", "views"
MANY, CAMERA, ESTIMATION = "many photographs", "camera", "estimation"
GROUPS = {
    INPUT: None,
    OUTPUT: None,
    VIEWS: None,
    MANY: "A hidden manifest beside the results says what is done. Ctrl-C, a kill or a power cut loses "
    "only the photographs in hand.",
    CAMERA: "Known intrinsics give the essential matrix E and the pose. Without these options the focal "
    "length of EXIF, where there is one, is a hint, and nothing is called calibrated. What is stated here is "
    "believed; if EXIF says 1.4 times as much or as little, a line says so.",
    ESTIMATION: "A smear is the path of a scene point in the picture while the shutter was open; its two "
    "ends are a match whose order in time is unknown.",
}
"""Groups of options in the order of ``--help-all``, with what stands above them."""
CONVERT: dict[Any, Callable[[str], Any]] = {Path: file_path, int: whole(1), float: float}
"""What makes a value of a word, by the type of the field; ValueError or ArgumentTypeError of a wrong one."""


def option(
    default: Any,
    metavar: str | None = None,
    *,
    group: str = OUTPUT,
    names: str = "",
    either: str = "",
    convert: Callable[[str], Any] | None = None,
    result: bool = False,
    **shown: Any,
) -> Any:
    """Return the field of an option, which the text below it explains.

    It is called ``names``, by default --NAME, a flag that is true without it --no-NAME, and one that may also
    be None both, one of None or words may be repeated; what has neither a default (`MISSING`) nor names is an
    argument. Options with one word of ``either`` exclude each other; ``convert`` is by default that of
    `CONVERT`. With ``result`` what is made of a photograph depends on it: --resume does that again where it
    has changed. ``shown`` are attributes of argparse, as choices; ``rare``, if --help-all alone has the
    option; and what the text has, as %(cutoff)s.
    """
    metadata = {"group": group, "names": names.split(), "either": either, "convert": convert}
    return field(
        default=default, metadata=metadata | {"result": result, "shown": {"metavar": metavar, **shown}}
    )


@dataclass(frozen=True, kw_only=True)
class Options:
    """What every command has, and what its help says.

    The description is the text of the class below its first line.
    """

    command: ClassVar[str]
    examples: ClassVar[tuple[str, ...]]
    tables: ClassVar[Mapping[str, Rows]] = {}

    verbose: bool = option(False, names="-v --verbose", either="verbosity")
    "print all details, as of an estimate its reason, matrices, models and timings"
    quiet: bool = option(False, names="-q --quiet", either="verbosity")
    "print failures only"

    def execute(self) -> int:
        """Return the exit code of the command, after running it."""
        raise NotImplementedError


def texts(kind: type) -> dict[str, str]:
    """Return what stands below the fields of a class and its bases, by their names."""
    above = reversed(kind.__mro__[:-1])
    return {list(types)[-1]: text for base in above for types, text in explained(base)}


def declared(kind: type[Options]) -> list[Field[Any]]:
    """Return the options of a command, group by group, in each its own before those that it shares."""
    known = {one.name: one for one in fields(kind) if "group" in one.metadata}
    names = dict.fromkeys(name for one in kind.__mro__ for name in vars(one).get("__annotations__", ()))
    own = [known[name] for name in names if name in known]
    return sorted(own, key=lambda one: list(GROUPS).index(one.metadata["group"]))


def add_options(parser: Any, kind: type[Options]) -> None:
    """Add the options of a command to its parser."""
    groups: dict[str, Any] = {}
    for one in declared(kind):
        group, either = one.metadata["group"], one.metadata["either"]
        if group not in groups:
            groups[group] = parser.add_argument_group(group, GROUPS[group])
        if either and either not in groups:
            groups[either] = groups[group].add_mutually_exclusive_group()
        names, settings = _settings(one)
        vars(groups[either or group].add_argument(*names, **settings)).update(one.metadata["shown"])


def _settings(one: Field[Any]) -> tuple[list[str], dict[str, Any]]:
    """Return what argparse must know to read an option: its names, and how."""
    needed, names, flag = one.default is MISSING, one.metadata["names"], one.name.replace("_", "-")
    kinds = get_args(one.type) or (one.type,)
    how = {
        "type": one.metadata["convert"] or next((CONVERT[kind] for kind in kinds if kind in CONVERT), None)
    }
    if one.type is bool:
        how = {"action": "store_false" if one.default else "store_true"}
        flag = f"no-{flag}" if one.default else flag
    elif one.type == bool | None:
        how = {"action": BooleanOptionalAction}
    elif one.type == list[str] | None:
        how = {"action": "append"}
    if needed and not names:
        return [one.name], how | ({"nargs": "+"} if one.type == list[str] else {})
    how |= {"required": True} if needed else {"default": one.default}
    return names or [f"--{flag}"], how | {"dest": one.name}
