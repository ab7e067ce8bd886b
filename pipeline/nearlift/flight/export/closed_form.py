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


#: Operations by the type of their node, as `fold` names them; a power is a call, since not every
#: language has an operator.
SIGNS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "pow"}
FUNCTIONS: dict[str, np.ufunc] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "negative": np.negative,
    "pow": np.power,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "log": np.log,
}


def fold(node: ast.expr, values: Mapping[str, float]) -> ast.expr:
    """Constant folding in double precision: `values` replace every name but `z`. What is left are
    `z`, constants, and calls of `FUNCTIONS`.
    """
    if isinstance(node, ast.Name):
        return node if node.id == "z" else ast.Constant(float(values[node.id]))
    if isinstance(node, ast.Constant):
        return ast.Constant(_number(node))
    if isinstance(node, ast.UnaryOp):
        name, parts = "negative", [node.operand]
    elif isinstance(node, ast.BinOp):
        name, parts = SIGNS[type(node.op)], [node.left, node.right]
    else:
        name, parts = _call(node)
    parts = [fold(part, values) for part in parts]
    whole = ast.Call(ast.Name(name), parts, [])
    if all(isinstance(part, ast.Constant) for part in parts):
        return ast.Constant(float(evaluate(whole, np.zeros(1))[0]))
    return whole


def _number(node: ast.Constant) -> float:
    return float(node.value)  # type: ignore[arg-type]


def _call(node: ast.expr) -> tuple[str, list[ast.expr]]:
    """Name of the function called, and its arguments."""
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    return node.func.id, node.args


def evaluate(node: ast.expr, z: FloatArray) -> FloatArray:
    """Value of a folded expression at heights `z`, in double precision."""
    if isinstance(node, ast.Name):
        return z
    if isinstance(node, ast.Constant):
        return np.full(z.shape, _number(node))
    name, parts = _call(node)
    value: FloatArray = FUNCTIONS[name](*(evaluate(part, z) for part in parts))
    return value


def write(node: ast.expr, *, number: str, call: str) -> str:
    """Source text of a folded expression, fully bracketed; `number` formats a constant, `call` a
    function's name (``"{}f"`` for C).
    """
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Constant):
        written = number.format(repr(_number(node)))
        return f"({written})" if _number(node) < 0 else written
    name, parts = _call(node)
    texts = [write(part, number=number, call=call) for part in parts]
    if name == "negative":
        return f"(-{texts[0]})"
    if name in SIGNS.values() and name != "pow":
        return f"({texts[0]} {name} {texts[1]})"
    return f"{call.format(name)}({', '.join(texts)})"
