"""The base of all documents, and that of a photograph that failed."""

import ast
import inspect
import json
import re
from dataclasses import asdict, dataclass, fields
from typing import Any, Self

Matrix = list[list[float]]
JSON_TYPES = {"Matrix": "3x3", "dict": "object", "tuple": "list of 2 str"}


class Document:
    """Base of the documents, which are frozen dataclasses of plain JSON types and of each other.

    A text below a field, or below several, explains them.
    """

    null = " or null"  # how the explanations call what may be missing

    @classmethod
    def from_attributes(cls, source: Any) -> Self | None:
        """Return the document of what has its fields as attributes, None of None; arrays become lists."""
        if source is None:
            return None
        values = {field.name: getattr(source, field.name) for field in fields(cls)}  # type: ignore[arg-type]
        values |= {name: list(one) for name, one in values.items() if isinstance(one, tuple)}
        return cls(**values | {name: one.tolist() for name, one in values.items() if hasattr(one, "tolist")})

    def to_json(self, indent: int | None = 2) -> str:
        """Return the document as JSON text, without ``indent`` on one line.

        NaN and infinity are errors of the program.
        """
        fields: Any = self
        return json.dumps(asdict(fields), indent=indent, allow_nan=False)

    @classmethod
    def explanations(cls) -> list[tuple[str, str]]:
        """Return the keys, and what explains them after their types."""
        (definition,) = ast.parse(inspect.getsource(cls)).body
        rows: list[tuple[str, str]] = []
        kinds: dict[str, str] = {}
        for node in definition.body:  # type: ignore[attr-defined]
            match node:
                case ast.AnnAssign(target=ast.Name(id=name), annotation=annotation):
                    kinds[name] = cls._json_type(ast.unparse(annotation))
                case ast.Expr(value=ast.Constant(value=str(text))) if kinds:
                    kind = kinds[name] if len(set(kinds.values())) == 1 else "number"
                    rows.append((", ".join(kinds), f"({kind}) {' '.join(text.split())}"))
                    kinds = {}
        return rows

    @classmethod
    def _json_type(cls, annotation: str) -> str:
        name = re.match(r"\w+", annotation)[0]  # type: ignore[index]
        kind = "object" if name.endswith("Document") else JSON_TYPES.get(name, name)
        return kind + cls.null * annotation.endswith("| None")


@dataclass(frozen=True, kw_only=True)
class FailureDocument(Document):
    """A photograph that failed."""

    image: str
    """The photograph as it was named."""
    error: str
    """What is wrong and how to mend it, one line."""
