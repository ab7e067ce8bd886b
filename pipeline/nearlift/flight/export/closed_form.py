"""Closed forms in one small language, for programs that know nothing of numpy.

Each is an expression in `z` (z_hat), the model's parameters and geometry, written with + - * / **
and sqrt, exp, log, pow; effects stand on `r`, the ratio so far. Nothing is taken on trust: whoever
exports one compares it with the declaration over the whole range first. A model without an entry (a
plug-in) is exported as a table alone.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping

import numpy as np

from nearlift.declare import FloatArray, LiftModel

_IMAGES = "1/(16*z*z) + z/(spacing_hat**2 + 4*z*z)**1.5 + z/(2*(2*spacing_hat**2 + 4*z*z)**1.5)"
_FOUNTAIN = "2*K_b*z/(diagonal_hat**2 + 4*z*z)**1.5"
_GAMMA = "(0.5 + 0.5*sqrt(1 + alpha/(z*z)))"

MODELS: Mapping[str, str] = {
    "cheeseman_bennett": "1/(1 - k/(16*z*z))",
    "cheeseman_bennett_fixed": "1/(1 - 1/(16*z*z))",
    "sanchez_cuevas": f"1/(1 - ({_IMAGES} + {_FOUNTAIN}))",
    "sanchez_cuevas_free_exponent": f"pow(1/(1 - ({_IMAGES} + {_FOUNTAIN})), n)",
    "exponential": "1 + a*exp(-b*z)",
    "power_law": "1 + a*pow(z, -p)",
    "hsiao_chirarattananon": _GAMMA,
    "hsiao_chirarattananon_constant_power": f"pow({_GAMMA}, 2/3)",
    "hsiao_chirarattananon_free_exponent": f"pow({_GAMMA}, n)",
    "ceiling_exponential": "1 + a*exp(-b*z)",
    "ceiling_power_law": "1 + a*pow(z, -p)",
    "sidewall_decay": "1 - a*exp(-z/lambda_)",
    "sidewall_power_law": "1 - a*pow(1 + z, -p)",
}
EFFECTS: Mapping[str, str] = {
    "near_wall_saturation": "r + (r - 1)*(pow(1 + gap_hat2/(z*z), -saturation_power) - 1)",
    "held_quantity": "pow(r, held_exponent)",
    # the power law is held below 0.2 radii: the larger of z and 0.2, in functions that C has in
    # `float` too
    "airframe_stagnation": (
        "r + stagnation*pow(0.5*(z + 0.2 + sqrt((z - 0.2)*(z - 0.2))), -stagnation_power)"
    ),
    "plate_edge": "r - (r - 1)*edge_share*exp(-edge_width_hat*edge_width_hat/(z*z))",
    "image_strength": "r/(1 - (strength - 1)*(r - 1))",
    # in time, not in height: at its reference the supply changes nothing
    "supply_sag": "r",
}
CALLS = ("sqrt", "exp", "log", "pow")


def closed_form(model: LiftModel, effects: tuple[str, ...]) -> ast.expr | None:
    """The expression of a base model with effects added in their order; None where one of them has
    none.
    """
    base = model.name.partition("_with_")[0]
    if base not in MODELS or any(e not in EFFECTS for e in effects):
        return None
    whole = ast.parse(MODELS[base], mode="eval").body
    for effect in effects:
        whole = _put(ast.parse(EFFECTS[effect], mode="eval").body, whole)
    return whole


class _Ratio(ast.NodeTransformer):
    def __init__(self, inner: ast.expr) -> None:
        self.inner = inner

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """The ratio so far in place of `r`."""
        return self.inner if node.id == "r" else node


def _put(outer: ast.expr, inner: ast.expr) -> ast.expr:
    placed: ast.expr = _Ratio(inner).visit(outer)
    return placed


def fold(node: ast.expr, values: Mapping[str, float]) -> ast.expr:
    """The expression with every part that does not contain `z` worked out, in double precision."""
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
    """The value of a folded expression at heights `z`, in double precision."""
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
    """The expression as source text, fully bracketed; `number` formats a constant (``"{}f"`` for
    C), `call` a function (``"{}f"``).

    Powers become calls of `pow`, since not every language has an operator; a square is a product.
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
