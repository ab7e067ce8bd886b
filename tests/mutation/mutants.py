"""Mutants: one small change each of the code of a function or of a numeric constant."""

from __future__ import annotations

import ast
import hashlib
import itertools
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SWAPPED: dict[Any, Any] = {
    a: b
    for pair in (
        (ast.Lt, ast.GtE),
        (ast.Gt, ast.LtE),
        (ast.Eq, ast.NotEq),
        (ast.Is, ast.IsNot),
        (ast.In, ast.NotIn),
        (ast.Add, ast.Sub),
        (ast.Mult, ast.Div),
        (ast.And, ast.Or),
    )
    for a, b in (pair, pair[::-1])
} | {ast.Pow: ast.Mult}
#: Of counts; of measured numbers it would change nothing.
WITH_OR_WITHOUT_EQUAL: dict[Any, Any] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
}


@dataclass(frozen=True)
class Mutant:
    """One change of one file: the node number `index` of its tree, `before`, becomes `after`."""

    path: Path
    within: str
    line: int
    index: int
    kind: str
    before: str
    after: str

    @property
    def key(self) -> str:
        """What is changed in which function or constant; not on which line, which moves."""
        return f"{self.path.as_posix()} {self.within}: `{self.before}` -> `{self.after}`"

    @property
    def is_constant(self) -> bool:
        """Whether a constant of the module is changed, and no function."""
        return self.within.isupper()

    def lines(self, root: Path) -> range:
        """From the start of the statement that is changed to the change."""
        tree = ast.parse((root / self.path).read_text(encoding="utf-8"))
        node: Any = list(ast.walk(tree))[self.index]
        around = [s for s in ast.walk(tree) if isinstance(s, ast.stmt) and s.lineno <= node.lineno]
        start = max(s.lineno for s in around if (s.end_lineno or 0) >= node.end_lineno)
        return range(start, node.end_lineno + 1)

    def source(self, root: Path) -> str:
        """The changed file."""
        tree = ast.parse((root / self.path).read_text(encoding="utf-8"))
        old = list(ast.walk(tree))[self.index]
        new = next(node for kind, node in changes(old) if kind == self.kind)

        class Replaced(ast.NodeTransformer):
            def visit(self, node: ast.AST) -> Any:
                return new if node is old else self.generic_visit(node)

        return ast.unparse(ast.fix_missing_locations(Replaced().visit(tree)))


def counts(*compared: ast.expr) -> bool:
    """Whether whole numbers above 0 or lengths are compared; 0 is what a measured number is
    compared with.
    """
    texts = [ast.unparse(side) for side in compared]
    return any((t.isdigit() and t != "0") or t.startswith("len(") or ".size" in t for t in texts)


def changes(node: Any) -> Iterator[tuple[str, ast.expr]]:
    """Every change of a node, by kind."""
    match node:
        case ast.Compare(left, [first, *more], right) if type(first) in SWAPPED:
            swapped = WITH_OR_WITHOUT_EQUAL if counts(left, *right) else SWAPPED
            sign = swapped.get(type(first), SWAPPED[type(first)])
            yield "comparison", ast.Compare(left, [sign(), *more], right)
        case ast.BinOp(left, sign, right) if type(sign) in SWAPPED:
            yield "operator", ast.BinOp(left, SWAPPED[type(sign)](), right)
            if isinstance(sign, ast.Add | ast.Sub):
                yield "dropped term", left
        case ast.BoolOp(sign, values):
            yield "operator", ast.BoolOp(SWAPPED[type(sign)](), values)
            yield "dropped term", values[0]
        case ast.UnaryOp(ast.USub() | ast.Not(), operand):
            yield "sign", operand
        case ast.Constant(bool()):
            pass
        case ast.Constant(float(value)):
            yield "constant", ast.Constant(2 * value if value else 0.1)
        case ast.Constant(int(value)):
            yield "off by one", ast.Constant(value + 1)


def mutable(tree: ast.Module) -> dict[int, str]:
    """By identity, the nodes in bodies of functions and in numeric constants of the module, with
    the name of that; what stands in annotations, decorators and messages is left alone.
    """
    todo: list[tuple[str, ast.AST]] = [
        (n.name, part) for n in ast.walk(tree) if isinstance(n, ast.FunctionDef) for part in n.body
    ]
    todo += [
        (ast.unparse(n.targets[0]), n.value)
        for n in tree.body
        if isinstance(n, ast.Assign) and isinstance(n.value, ast.Constant | ast.BinOp)
    ]
    inside: dict[int, str] = {}
    while todo:
        within, node = todo.pop()
        if isinstance(node, ast.Raise | ast.JoinedStr):
            continue
        inside[id(node)] = within
        for name, value in ast.iter_fields(node):
            if name not in ("annotation", "returns", "decorator_list"):
                children = value if isinstance(value, list) else [value]
                todo += [(within, child) for child in children if isinstance(child, ast.AST)]
    return inside


def every(root: Path, path: Path) -> list[Mutant]:
    """Every mutant of a file, whose `path` is relative to `root`; of several that read alike, the
    first.
    """
    tree = ast.parse((root / path).read_text(encoding="utf-8"))
    inside = mutable(tree)
    nodes: list[tuple[int, Any]] = [(i, n) for i, n in enumerate(ast.walk(tree)) if id(n) in inside]
    mutants = [
        Mutant(path, inside[id(node)], node.lineno, i, kind, ast.unparse(node), ast.unparse(after))
        for i, node in nodes
        for kind, after in changes(node)
    ]
    return list({m.key: m for m in reversed(mutants)}.values())


def drawn(root: Path, rooms: Sequence[Path], count: int, seed: int) -> list[Mutant]:
    """`count` mutants, from each package in turn, and in a package as many of each kind as can be. A draw
    goes by a digest of what is changed, so that code written elsewhere leaves it as it is.
    """

    def lot(mutant: Mutant) -> bytes:
        return hashlib.sha256(f"{seed} {mutant.key}".encode()).digest()

    chosen: list[list[Mutant]] = []
    for number, room in enumerate(rooms):
        kinds: dict[str, list[Mutant]] = defaultdict(list)
        place = root / room
        for file in [place] if place.is_file() else sorted(place.rglob("*.py")):
            for mutant in every(root, file.relative_to(root)):
                kinds[mutant.kind].append(mutant)
        for mutants in kinds.values():
            mutants.sort(key=lot)
        share = count * (number + 1) // len(rooms) - count * number // len(rooms)
        turns = [m for row in range(share) for k in sorted(kinds) for m in kinds[k][row : row + 1]]
        chosen.append(turns[:share])
    return [m for row in itertools.zip_longest(*chosen) for m in row if m is not None]
