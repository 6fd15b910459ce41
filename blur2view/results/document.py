"""The base of all documents, and that of a photograph that failed."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

Matrix = list[list[float]]


class Document:
    """Base of the documents, which are frozen dataclasses of plain JSON types and of each other."""

    def to_json(self, indent: int | None = 2) -> str:
        """Return the document as JSON text, without ``indent`` on one line.

        NaN and infinity are errors of the program.
        """
        fields: Any = self
        return json.dumps(asdict(fields), indent=indent, allow_nan=False)


@dataclass(frozen=True, kw_only=True)
class FailureDocument(Document):
    """A photograph that failed.

    Parameters
    ----------
    image : str
        The photograph as it was named.
    error : str
        What is wrong and how to mend it, one line.
    """

    image: str
    error: str
