"""Small changes of a module's source: where they can be made, and the source with one of them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass

TURNED: dict[type[ast.cmpop], str] = {
    ast.Lt: ">=", ast.GtE: "<", ast.Gt: "<=", ast.LtE: ">", ast.Eq: "!=", ast.NotEq: "==",
    ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
BOUNDARY: dict[type[ast.cmpop], str] = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">"}
OPERATORS: dict[type[ast.operator], str] = {
    ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "*", ast.Mod: "*", ast.Pow: "*",
    ast.BitAnd: "|", ast.BitOr: "&",
}  # fmt: skip
EXCHANGED = {
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all", "all": "any",
    "sin": "cos", "cos": "sin", "argmin": "argmax", "argmax": "argmin", "floor": "ceil", "ceil": "floor",
    "exp": "log", "log": "exp", "sqrt": "square",
}  # fmt: skip
LEFT_ALONE = (ast.JoinedStr, ast.arguments, ast.Import, ast.ImportFrom)
GUARDS = 1e-5, 1e5  # smaller and larger numbers keep zeros from dividing, or stand for infinity


@dataclass(frozen=True, kw_only=True)
class Mutant:
    """A module, "blur2view/...", with one change: in which function, which line, its source.

    Outside of functions ``function`` is the name that is given a value there, "" if there is none.
    """

    path: str
    function: str
    line: int
    change: str
    source: str


@dataclass(frozen=True, kw_only=True)
class _Edit:
    """A node to be replaced by a text."""

    node: ast.AST
    text: str


def mutants_of(path: str, source: str) -> Iterator[Mutant]:
    """Yield every mutant of a module, in the order of its nodes.

    Left alone are texts, annotations, decorators, defaults of arguments, and numbers that are `GUARDS`.
    """
    offsets = [0]
    for line in source.splitlines(keepends=True):
        offsets.append(offsets[-1] + len(line.encode()))
    encoded = source.encode()
    for function, edit in _edits(ast.parse(source), ""):
        node = edit.node
        assert isinstance(node, ast.expr | ast.stmt) and node.end_lineno and node.end_col_offset is not None
        start = offsets[node.lineno - 1] + node.col_offset
        end = offsets[node.end_lineno - 1] + node.end_col_offset
        before = " ".join(encoded[start:end].decode().split())
        changed = (encoded[:start] + edit.text.encode() + encoded[end:]).decode()
        after = " ".join(edit.text.split())
        yield Mutant(
            path=path,
            function=function,
            line=node.lineno,
            change=f"`{before}` to `{after}`",
            source=changed,
        )


def _edits(node: ast.AST, function: str) -> Iterator[tuple[str, _Edit]]:
    """Yield the edits of a node and of what it holds, with the outermost function, or method, around."""
    match node:
        case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)):
            function = function if "()" in function else name
    for edit in _own_edits(node):
        yield function, edit
    if isinstance(node, ast.FunctionDef):
        within = function if "()" in function else f"{function}{node.name}()"
        for child in node.body:
            yield from _edits(child, within)
    elif isinstance(node, ast.ClassDef):
        for child in node.body:
            method = isinstance(child, ast.FunctionDef)
            yield from _edits(child, f"{node.name}." if method and not function else function)
    else:
        for name, value in ast.iter_fields(node):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST) and not isinstance(child, LEFT_ALONE) and name != "annotation":
                    yield from _edits(child, function)


def _own_edits(node: ast.AST) -> Iterator[_Edit]:
    """Yield the edits of one node."""
    match node:
        case ast.Compare(left=left, ops=[kind], comparators=[right]):
            for table in (TURNED, BOUNDARY) if _counts(left) or _counts(right) else (TURNED,):
                if word := table.get(type(kind)):
                    yield _Edit(node=node, text=f"({ast.unparse(left)} {word} {ast.unparse(right)})")
        case ast.BinOp(left=left, op=kind, right=right) if not isinstance(left, ast.List | ast.Constant) or (
            not isinstance(left, ast.List) and not isinstance(left.value, str)
        ):
            one, other = ast.unparse(left), ast.unparse(right)
            if word := OPERATORS.get(type(kind)):
                yield _Edit(node=node, text=f"(({one}) {word} ({other}))")
            elif isinstance(kind, ast.MatMult):
                yield _Edit(node=node, text=f"(({other}) @ ({one}))")
        case ast.UnaryOp(op=ast.USub() | ast.Not() | ast.Invert(), operand=operand):
            yield _Edit(node=node, text=f"({ast.unparse(operand)})")
        case ast.BoolOp(op=kind, values=values):
            word = " or " if isinstance(kind, ast.And) else " and "
            yield _Edit(node=node, text=f"({word.join(f'({ast.unparse(value)})' for value in values)})")
        case ast.Constant(value=bool(value)):
            yield _Edit(node=node, text=str(not value))
        case ast.Constant(value=int(value)):
            yield _Edit(node=node, text=str(value + 1))
        case ast.Constant(value=float(value)) if value == 0 or GUARDS[0] <= value <= GUARDS[1]:
            yield _Edit(node=node, text=repr(2 * value or 1.0))
        case ast.Call(func=ast.Attribute(value=owner, attr=name)) if name in EXCHANGED:
            yield _Edit(node=node.func, text=f"({ast.unparse(owner)}).{EXCHANGED[name]}")
        case ast.Call(func=ast.Name(id=name)) if name in EXCHANGED:
            yield _Edit(node=node.func, text=EXCHANGED[name])
        case ast.If(test=test) | ast.IfExp(test=test) if not isinstance(test, ast.Compare | ast.UnaryOp):
            yield _Edit(node=test, text=f"(not ({ast.unparse(test)}))")
        case ast.Expr(value=ast.Call()) | ast.AugAssign() | ast.Raise():
            yield _Edit(node=node, text="pass")


def _counts(node: ast.expr) -> bool:
    """Return whether an expression is surely a whole number, for which a limit's own value matters."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int)
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "len"
