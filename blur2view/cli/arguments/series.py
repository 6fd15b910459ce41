"""Options of commands whose results are a stream: documents as they are made, the order in time."""

import argparse
from collections.abc import Callable
from typing import Any


def add_json(add: Callable[..., Any]) -> None:
    """Describe the documents on standard output."""
    add("--json", action="store_true", help="print one JSON document instead of the summaries, see below")
    add(
        "--jsonl",
        action="store_true",
        help="instead print the JSON document of each photograph on one line as soon as it is done, in their "
        "order; of one that fails image and error",
    )


def add_sequence(add: Callable[..., Any]) -> None:
    """Describe whether neighbours decide the order in time."""
    add(
        "--sequence",
        action=argparse.BooleanOptionalAction,
        help="the photographs are a video in this order: those before and after each one show which end of "
        "its exposure came first, so that rates are one series; with --no-sequence not even the frames of a "
        "video do (default: those of a video)",
    )
