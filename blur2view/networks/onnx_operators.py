"""What an ONNX file is made of, read off its bytes before anything of it is run.

ONNX Runtime runs parts of a network while it loads it and tells nobody what is in it; the ``onnx`` package is
not needed to run networks. So the few fields that matter are read here: the Protocol Buffers wire format
(https://protobuf.dev/programming-guides/encoding) and the numbers of onnx.proto.
"""

from __future__ import annotations

from collections.abc import Iterator

MODEL_GRAPH, MODEL_FUNCTIONS = 7, 25
GRAPH_NODE, GRAPH_WEIGHTS = 1, 5
NODE_OPERATOR, NODE_ATTRIBUTE, NODE_DOMAIN = 4, 5, 7
ATTRIBUTE_WEIGHTS, ATTRIBUTE_GRAPHS, ATTRIBUTE_INTEGERS = (5, 10), (6, 11), (3, 8)
WEIGHTS_ELSEWHERE = 13
VARINT, FIXED64, LENGTH, FIXED32 = 0, 1, 2, 5
FIXED_BYTES = {FIXED64: 8, FIXED32: 4}
MAX_NODES, MAX_INTEGER = 10_000, 32
"""The shipped network has 1362 nodes, and sides of windows are the largest integers of its attributes."""


def operators(content: bytes) -> set[str]:
    """Return the operators of a model's graph, ``domain.name`` for those that are not ONNX's own.

    What could run anything, or for very long, is returned like an operator: "a function", "a subgraph",
    "weights in another file", "an integer of 4000" where a window is that large, "20000 nodes".

    Raises
    ------
    ValueError
        If these bytes are no message.
    """
    used, nodes = set(), 0
    for number, graph in fields(content):
        if number == MODEL_FUNCTIONS:
            used.add("a function")
        for part, value in fields(message(graph)) if number == MODEL_GRAPH else ():
            nodes += part == GRAPH_NODE
            if part == GRAPH_NODE:
                used.update(operators_of(message(value)))
            elif part == GRAPH_WEIGHTS:
                used.update(elsewhere(message(value)))
    return used if nodes <= MAX_NODES else used | {f"{nodes} nodes"}


def operators_of(node: bytes) -> Iterator[str]:
    """Yield the operator of a node, after its domain if it has one, and what its attributes must not have."""
    parts = list(fields(node))
    domain = "".join(f"{text(value)}." for number, value in parts if number == NODE_DOMAIN and value)
    for number, value in parts:
        if number == NODE_OPERATOR:
            yield domain + text(value)
        elif number == NODE_ATTRIBUTE:
            yield from foreign_attribute(message(value))


def foreign_attribute(attribute: bytes) -> Iterator[str]:
    """Yield what no attribute of ours has: a subgraph, weights in another file, a large integer."""
    for number, value in fields(attribute):
        if number in ATTRIBUTE_GRAPHS:
            yield "a subgraph"
        elif number in ATTRIBUTE_WEIGHTS:
            yield from elsewhere(message(value))
        elif number in ATTRIBUTE_INTEGERS:
            large = [one for one in integers(value) if MAX_INTEGER < one < 1 << 63]  # from there on negative
            yield from (f"an integer of {one}" for one in large)


def elsewhere(weights: bytes) -> Iterator[str]:
    """Yield a word about weights that another file holds."""
    if any(number == WEIGHTS_ELSEWHERE for number, _ in fields(weights)):
        yield "weights in another file"


def integers(value: bytes | int) -> Iterator[int]:
    """Yield the integers of a field that has one, or several packed."""
    if isinstance(value, int):
        yield value
        return
    place = 0
    while place < len(value):
        one, place = varint(value, place)
        yield one


def message(value: bytes | int) -> bytes:
    """Return a field's content that has a length; ValueError of a number."""
    if isinstance(value, int):
        raise ValueError(f"expected a message, got {value}")
    return value


def text(value: bytes | int) -> str:
    """Return bytes as text; what is none is replaced."""
    return message(value).decode(errors="replace")


def fields(content: bytes) -> Iterator[tuple[int, bytes | int]]:
    """Yield number and content of a message's integers and fields of a length; ValueError if it is none."""
    place, end = 0, len(content)
    while place < end:
        key, place = varint(content, place)
        number, kind = (key & 0xFFFFFFFF) >> 3, key & 7  # tags have 32 bits
        if kind == VARINT:
            value, place = varint(content, place)
            yield number, value
        elif kind in FIXED_BYTES:
            place += FIXED_BYTES[kind]
        elif kind == LENGTH:
            size, place = varint(content, place)
            yield number, content[place : place + size]
            place += size
        else:
            raise ValueError(f"expected a Protocol Buffers message, got a field of kind {kind}")
    if place != end:
        raise ValueError(f"expected a message of {place} bytes, got {end}")


def varint(content: bytes, place: int) -> tuple[int, int]:
    """Return the number that begins at a place, and where it ends."""
    value = 0
    for shift in range(0, 70, 7):
        if place >= len(content):
            break
        byte = content[place]
        place += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value & (1 << 64) - 1, place  # as protobuf reads it
    raise ValueError("expected a number of at most ten bytes")
