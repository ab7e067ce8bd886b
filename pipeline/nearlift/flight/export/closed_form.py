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
        return ast.Constant(float(node.value))  # type: ignore[arg-type]
    if isinstance(node, ast.UnaryOp):
        inner = fold(node.operand, values)
        return (
            ast.Constant(-_number(inner))
            if isinstance(inner, ast.Constant)
            else ast.UnaryOp(node.op, inner)
        )
    if isinstance(node, ast.BinOp):
        left, right = fold(node.left, values), fold(node.right, values)
        whole: ast.expr = ast.BinOp(left, node.op, right)
        return (
            ast.Constant(_evaluate(whole))
            if isinstance(left, ast.Constant) and isinstance(right, ast.Constant)
            else whole
        )
    assert isinstance(node, ast.Call)
    arguments = [fold(a, values) for a in node.args]
    call = ast.Call(node.func, arguments, [])
    return (
        ast.Constant(_evaluate(call))
        if all(isinstance(a, ast.Constant) for a in arguments)
        else call
    )


def _number(node: ast.expr) -> float:
    assert isinstance(node, ast.Constant)
    return float(node.value)  # type: ignore[arg-type]


def _evaluate(node: ast.expr) -> float:
    return float(evaluate(node, np.zeros(1))[0])


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
            value = _number(n)
            written = number.format(
                repr(value) if "." in repr(value) or "e" in repr(value) else f"{value!r}.0"
            )
            return f"({written})" if value < 0 else written
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
