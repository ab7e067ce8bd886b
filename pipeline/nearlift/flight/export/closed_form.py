"""Closed forms of lift models: parsing, constant folding, evaluation, and source text.

A closed form is the `closed_form` of a declaration: an expression in `z` (z_hat), the model's
parameters and geometry. Before an export it is compared with the declaration over the whole range;
a model without one is exported as a table alone.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping

import numpy as np

from nearlift.declare import FloatArray, LiftModel


def closed_form(model: LiftModel) -> ast.expr | None:
    """Parsed closed form of a model; None where it or one of its effects declares none."""
    return ast.parse(model.closed_form, mode="eval").body if model.closed_form else None


def fold(node: ast.expr, values: Mapping[str, float]) -> ast.expr:
    """Constant folding in double precision: `values` replace every name but `z`."""
    if isinstance(node, ast.Name):
        return node if node.id == "z" else ast.Constant(float(values[node.id]))
    if isinstance(node, ast.Constant):
        return ast.Constant(_number(node))
    whole: ast.expr
    if isinstance(node, ast.UnaryOp):
        parts = [fold(node.operand, values)]
        whole = ast.UnaryOp(node.op, *parts)
    elif isinstance(node, ast.BinOp):
        parts = [fold(node.left, values), fold(node.right, values)]
        whole = ast.BinOp(parts[0], node.op, parts[1])
    else:
        assert isinstance(node, ast.Call)
        parts = [fold(a, values) for a in node.args]
        whole = ast.Call(node.func, parts, [])
    if all(isinstance(part, ast.Constant) for part in parts):
        return ast.Constant(float(evaluate(whole, np.zeros(1))[0]))
    return whole


def _number(node: ast.expr) -> float:
    assert isinstance(node, ast.Constant)
    return float(node.value)  # type: ignore[arg-type]


def evaluate(node: ast.expr, z: FloatArray) -> FloatArray:
    """Value of a folded expression at heights `z`, in double precision."""
    if isinstance(node, ast.Name):
        return z
    if isinstance(node, ast.Constant):
        return np.full(z.shape, _number(node))
    if isinstance(node, ast.UnaryOp):
        return -evaluate(node.operand, z)
    if isinstance(node, ast.BinOp):
        does = {
            ast.Add: np.add,
            ast.Sub: np.subtract,
            ast.Mult: np.multiply,
            ast.Div: np.divide,
            ast.Pow: np.power,
        }[type(node.op)]
        binary: FloatArray = does(evaluate(node.left, z), evaluate(node.right, z))
        return binary
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    function = {"sqrt": np.sqrt, "exp": np.exp, "log": np.log, "pow": np.power}[node.func.id]
    called: FloatArray = function(*(evaluate(a, z) for a in node.args))
    return called


def write(node: ast.expr, *, number: str, call: str) -> str:
    """Source text of a folded expression, fully bracketed; `number` formats a constant, `call` a
    function's name (``"{}f"`` for C).

    Powers become calls of `pow`, since not every language has an operator.
    """

    def text(n: ast.expr) -> str:
        if isinstance(n, ast.Name):
            return n.id
        if isinstance(n, ast.Constant):
            written = number.format(repr(_number(n)))
            return f"({written})" if _number(n) < 0 else written
        if isinstance(n, ast.UnaryOp):
            return f"(-{text(n.operand)})"
        if isinstance(n, ast.BinOp):
            if isinstance(n.op, ast.Pow):
                return f"{call.format('pow')}({text(n.left)}, {text(n.right)})"
            sign = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}[type(n.op)]
            return f"({text(n.left)} {sign} {text(n.right)})"
        assert isinstance(n, ast.Call)
        assert isinstance(n.func, ast.Name)
        return f"{call.format(n.func.id)}({', '.join(text(a) for a in n.args)})"

    return text(node)
