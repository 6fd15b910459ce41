"""Which operators an ONNX file uses, read off its bytes before anything of it is run.

ONNX Runtime runs parts of a network while it loads it and tells nobody what is in it; the ``onnx`` package is
not needed to run networks. So the few fields that matter are read here: the Protocol Buffers wire format
(https://protobuf.dev/programming-guides/encoding) and the numbers of onnx.proto.
"""

from __future__ import annotations

from collections.abc import Iterator

MODEL_GRAPH, MODEL_FUNCTIONS = 7, 25
GRAPH_NODE = 1
NODE_OPERATOR, NODE_DOMAIN = 4, 7
VARINT, FIXED64, LENGTH, FIXED32 = 0, 1, 2, 5
FIXED_BYTES = {FIXED64: 8, FIXED32: 4}


def operators(content: bytes) -> set[str]:
    """Return the operators of a model's graph, ``domain.name`` for those that are not ONNX's own.

    A model with functions of its own has the operator ``function``.

    Raises
    ------
    ValueError
        If these bytes are no message.
    """
    used = set()
    for number, graph in fields(content):
        if number == MODEL_FUNCTIONS:
            used.add("function")
        elif number == MODEL_GRAPH:
            nodes = (node for number, node in fields(graph) if number == GRAPH_NODE)
            used.update(name for node in nodes for name in names_of(node))
    return used


def names_of(node: bytes) -> list[str]:
    """Return the operator of a node, after its domain if it has one; all that it gives."""
    parts = list(fields(node))
    domain = "".join(f"{text(value)}." for number, value in parts if number == NODE_DOMAIN and value)
    return [domain + text(value) for number, value in parts if number == NODE_OPERATOR]


def text(value: bytes) -> str:
    """Return bytes as text; what is none is replaced."""
    return value.decode(errors="replace")


def fields(message: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield number and content of a message's fields that have a length; ValueError if it is none."""
    place, end = 0, len(message)
    while place < end:
        key, place = varint(message, place)
        kind, size = key & 7, 0
        if kind == VARINT:
            _, place = varint(message, place)
        elif kind in FIXED_BYTES:
            place += FIXED_BYTES[kind]
        elif kind == LENGTH:
            size, place = varint(message, place)
            yield key >> 3, message[place : place + size]
            place += size
        else:
            raise ValueError(f"expected a Protocol Buffers message, got a field of kind {kind}")
    if place != end:
        raise ValueError(f"expected a message of {place} bytes, got {end}")


def varint(message: bytes, place: int) -> tuple[int, int]:
    """Return the number that begins at a place, and where it ends."""
    value = 0
    for shift in range(0, 70, 7):
        if place >= len(message):
            break
        byte = message[place]
        place += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, place
    raise ValueError("expected a number of at most ten bytes")
