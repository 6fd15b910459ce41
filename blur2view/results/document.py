"""The base of all documents."""

import ast
import inspect
import json
import re
import textwrap
from collections.abc import Iterator
from dataclasses import asdict, fields
from enum import Enum
from typing import Any, Self

Matrix = list[list[float]]
JSON_TYPES = {"Matrix": "3x3", "dict": "object", "tuple": "list of 2 str"}


def explained(kind: type) -> Iterator[tuple[dict[str, str], str]]:
    """Yield the fields that a class itself declares, names with types, and the text below that is theirs."""
    (definition,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    types: dict[str, str] = {}
    for node in definition.body:  # type: ignore[attr-defined]
        match node:
            case ast.AnnAssign(target=ast.Name(id=name), annotation=annotation):
                types[name] = ast.unparse(annotation)
            case ast.Expr(value=ast.Constant(value=str(text))) if types:
                yield types, " ".join(text.split())
                types = {}


class Document:
    """Base of the documents, which are frozen dataclasses of plain JSON types and of each other.

    A text below a field, or below several, explains them.
    """

    null = " or null"  # how the explanations call what may be missing

    @classmethod
    def gathered(cls, *sources: Any, **stated: Any) -> Self:
        """Return the document of what is stated, else of the attributes of the first source that has them.

        Arrays become lists, enums their texts.
        """
        names = [field.name for field in fields(cls)]  # type: ignore[arg-type]
        for name in names:
            if name not in stated:
                stated[name] = next(getattr(one, name) for one in sources if hasattr(one, name))
        return cls(**{name: _json(stated[name]) for name in names})

    def to_json(self) -> str:
        """Return the document as JSON text; NaN and infinity are errors of the program."""
        return json.dumps(self.plain(), indent=2, allow_nan=False)

    def plain(self) -> dict[str, Any]:
        """Return what JSON holds of the document."""
        fields: Any = self
        return asdict(fields)

    @classmethod
    def explanations(cls) -> Iterator[tuple[str, str]]:
        """Yield the keys, and what explains them after their types."""
        for types, text in explained(cls):
            kinds = {cls._json_type(one) for one in types.values()}
            yield ", ".join(types), text if len(kinds) > 1 else f"({kinds.pop()}) {text}"

    @classmethod
    def _json_type(cls, annotation: str) -> str:
        name = re.match(r"\w+", annotation)[0]  # type: ignore[index]
        kind = "object" if name.endswith("Document") else JSON_TYPES.get(name, name)
        return kind + cls.null * annotation.endswith("| None")


def part(source: Any, *names: str) -> dict[str, Any] | None:
    """Return what a document holds of an object, its attributes of these names; None of None."""
    return None if source is None else {name: _json(getattr(source, name)) for name in names}


def _json(value: Any) -> Any:
    """Return an array or a tuple as a list, an enum as its text."""
    if isinstance(value, Enum):
        return str(value)
    return value.tolist() if hasattr(value, "tolist") else list(value) if isinstance(value, tuple) else value
