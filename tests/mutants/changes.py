"""Every change of one token of a source that may make it wrong; `python -m tests.mutants --random` draws some."""

import ast
import io
import tokenize
from bisect import bisect_left
from collections.abc import Iterator
from typing import Final, NamedTuple

OPERATORS: Final[dict[type[ast.AST], tuple[str, str]]] = {
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.Is: ("is", "is not"),
    ast.IsNot: ("is not", "is"),
    ast.In: ("in", "not in"),
    ast.NotIn: ("not in", "in"),
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.FloorDiv: ("//", "/"),
    ast.Mod: ("%", "//"),
    ast.Pow: ("**", "*"),
    ast.BitAnd: ("&", "|"),
    ast.BitOr: ("|", "&"),
    ast.LShift: ("<<", ">>"),
    ast.RShift: (">>", "<<"),
    ast.And: ("and", "or"),
    ast.Or: ("or", "and"),
}
SWAPPED: Final = {"min": "max", "minimum": "maximum", "argmin": "argmax", "any": "all", "floor": "ceil"}
NAMES: Final = SWAPPED | {after: before for before, after in SWAPPED.items()}

NOT_CODE: Final = {"annotation", "returns", "decorator_list", "bases", "type_params", "keywords"}


class Change(NamedTuple):
    """`after` in place of `before`, which begins at `start` (an index into the source's text)."""

    start: int
    before: str
    after: str

    def applied_to(self, text: str) -> str:
        """The text with the change in it."""
        return text[: self.start] + self.after + text[self.start + len(self.before) :]


def changes(text: str) -> list[Change]:
    """All changes of a source, in its order. Types and texts stay as they are: no test can see a type, and of the
    texts there are too many."""
    source = _Source(text)
    return sorted({change for node in _code(ast.parse(text)) for change in _of(node, source)})


class _Source:
    """A text, its tokens, and where the nodes of its tree stand in it."""

    def __init__(self, text: str) -> None:
        self.text = text
        self._lines = text.splitlines(keepends=True)
        self._starts = [0]
        for line in self._lines:
            self._starts.append(self._starts[-1] + len(line))
        self._tokens = [
            (self._starts[token.start[0] - 1] + token.start[1], token.string)
            for token in tokenize.generate_tokens(io.StringIO(text).readline)
            if token.type in {tokenize.OP, tokenize.NAME}
        ]

    def place(self, line: int, column: int) -> int:
        """The index of a line, from 1, and a column in bytes of UTF-8, as `ast` counts."""
        before = self._lines[line - 1].encode()[:column].decode()
        return self._starts[line - 1] + len(before)

    def begin(self, node: ast.expr) -> int:
        return self.place(node.lineno, node.col_offset)

    def end(self, node: ast.expr) -> int:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self.place(node.end_lineno, node.end_col_offset)

    def span(self, node: ast.expr) -> str:
        return self.text[self.begin(node) : self.end(node)]

    def operator(self, left: int, right: int, operator: ast.AST) -> Iterator[Change]:
        """The operator that stands between two operands, the end of one and the begin of the other."""
        before, after = OPERATORS.get(type(operator), ("", ""))
        first = before.partition(" ")[0]
        between = bisect_left(self._tokens, (left,)), bisect_left(self._tokens, (right,))
        for start, string in self._tokens[slice(*between)]:
            if before and string in {first, f"{first}="}:
                yield Change(start, before, after)
                return


def _code(tree: ast.AST) -> Iterator[ast.AST]:
    """All nodes that are executed for what they do: without types, and without decorators."""
    for name, value in ast.iter_fields(tree):
        if name in NOT_CODE and not isinstance(tree, ast.Call):  # a call's keywords are code
            continue
        for node in value if isinstance(value, list) else [value]:
            if isinstance(node, ast.AST) and not _is_type(node):
                yield node
                yield from _code(node)


def _is_type(node: ast.AST) -> bool:
    """Whether it names a type, or imports for types: an alias, as `Noise = Callable[[], float]`."""
    if isinstance(node, ast.If):
        return ast.unparse(node.test) == "TYPE_CHECKING"
    return (
        isinstance(node, ast.Assign)
        and isinstance(node.value, ast.Subscript)
        and ast.unparse(node.value.value) in {"Callable", "Literal", "Annotated", "dict", "tuple", "list"}
    )


def _is_other(node: ast.BinOp) -> bool:
    """Whether it is no arithmetic, but a union of types, as the second argument of `isinstance`, or a format."""
    if isinstance(node.op, ast.BitOr):
        return ast.unparse(node.right).rpartition(".")[2][0].isupper()
    return isinstance(node.left, ast.Constant) and isinstance(node.left.value, str | bytes)


def _of(node: ast.AST, source: _Source) -> Iterator[Change]:
    """The changes of one node, those of the nodes inside it left out."""
    if isinstance(node, ast.Compare):
        operands = [node.left, *node.comparators]
        for left, operator, right in zip(operands, node.ops, operands[1:], strict=False):
            yield from source.operator(source.end(left), source.begin(right), operator)
    elif isinstance(node, ast.BoolOp):
        for left, right in zip(node.values, node.values[1:], strict=False):
            yield from source.operator(source.end(left), source.begin(right), node.op)
    elif isinstance(node, ast.BinOp) and not _is_other(node):
        yield from source.operator(source.end(node.left), source.begin(node.right), node.op)
    elif isinstance(node, ast.AugAssign):
        yield from source.operator(source.end(node.target), source.begin(node.value), node.op)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        sign = "not " if isinstance(node.op, ast.Not) else "-"
        yield Change(source.begin(node), sign, "" if sign == "not " else "+")
    elif isinstance(node, ast.Constant):
        yield from _constant(node, source)
    elif isinstance(node, ast.Name) and node.id in NAMES:
        yield Change(source.begin(node), node.id, NAMES[node.id])
    elif isinstance(node, ast.Attribute) and node.attr in NAMES:
        yield Change(source.end(node) - len(node.attr), node.attr, NAMES[node.attr])
    elif isinstance(node, ast.If) and isinstance(node.body[-1], ast.Return | ast.Raise | ast.Continue | ast.Break):
        yield Change(source.begin(node.test), source.span(node.test), "False")


def _constant(node: ast.Constant, source: _Source) -> Iterator[Change]:
    before = source.span(node)
    if isinstance(node.value, bool):
        yield Change(source.begin(node), before, str(not node.value))
    elif isinstance(node.value, int):
        yield Change(source.begin(node), before, str(node.value + 1))
        yield Change(source.begin(node), before, str(node.value - 1))
    elif isinstance(node.value, float):
        yield Change(source.begin(node), before, repr(2.0 * node.value or 1.0))
