"""Python source of a fitted lift model: a module without dependencies, and CasADi expressions."""

from __future__ import annotations

from nearlift.flight.export.closed_form import write
from nearlift.flight.export.model_export import ModelExport

MODULE = '''"""{about}

ratio(boundary, z_hat) returns (L / L_inf, flag); it reads a table of cubic pieces in 1 / (1 + z_hat). Where the model has a formula,
closed(boundary, z_hat) evaluates that.
"""

from math import exp, log, pow, sqrt

# boundary: lowest and highest z_hat, power of the fall beyond it, first node, nodes per unit of w, values, slopes per piece
TABLES = {{
{tables}
}}
FORMULAS = {{
{formulas}
}}


def _clamp(z_hat, low, high):
    if z_hat != z_hat:
        return high, 2
    return (high, 1) if z_hat > high else (low, -1) if z_hat < low else (z_hat, 0)


def _beyond(ratio, z_hat, high, power, flag):
    # farther than measured, what the boundary adds falls smoothly, in the end as the square of distance
    if flag != 1:
        return 1.0 if flag == 2 else ratio
    s = z_hat / high - 1
    return 1 + (ratio - 1) / (1 + s * (power + s))


def ratio(boundary, z_hat):
    """L / L_inf, and 0 where that is measured, -1 nearer, +1 farther, 2 for what is no number."""
    low, high, power, first, per_w, value, slope = TABLES[boundary]
    z, flag = _clamp(z_hat, low, high)
    x = max((1 / (1 + z) - first) * per_w, 0.0)
    i = min(int(x), len(value) - 2)
    t = min(x - i, 1.0)
    a, p, q = value[i], slope[i], slope[i + 1]
    d = value[i + 1] - a
    found = a + t * (p + t * ((3 * d - 2 * p - q) + t * (p + q - 2 * d)))
    return _beyond(found, z_hat, high, power, flag), flag


def closed(boundary, z_hat):
    """The same by the formula."""
    low, high, power = TABLES[boundary][:3]
    z, flag = _clamp(z_hat, low, high)
    return _beyond(FORMULAS[boundary](z), z_hat, high, power, flag), flag
'''
CASADI = '''"""{about}

ratio(boundary, z_hat) is a CasADi expression of L / L_inf for a symbol or a number z_hat, held at the nearest station below it;
as its slope is zero there, keep an optimiser above RANGE's lower end by a constraint. Beyond the farthest, what the boundary adds falls
smoothly, in the end as the square of distance. Needs CasADi alone.
"""

from casadi import exp, fmax, fmin, log, power, sqrt

# boundary: lowest and highest z_hat, power of the fall beyond it
RANGE = {{
{ranges}
}}


def pow(base, exponent):
    return power(base, exponent)


FORMULAS = {{
{formulas}
}}


def ratio(boundary, z_hat):
    """Expression of L / L_inf."""
    low, high, power = RANGE[boundary]
    s = fmax(z_hat, high) / high - 1
    return 1 + (FORMULAS[boundary](fmin(fmax(z_hat, low), high)) - 1) / (1 + s * (power + s))
'''


def _formulas(export: ModelExport) -> str:
    return "\n".join(
        f"    {lift.boundary!r}: lambda z: {write(lift.closed, number='{}', call='{}')},"
        for lift in export.lifts
        if lift.closed is not None
    )


def _about(export: ModelExport) -> str:
    # it becomes a docstring, which quotes or backslashes could end
    return "\n".join(export.about()).replace("\\", "/").replace('"', "'")


def module(export: ModelExport) -> str:
    """Source of the module without dependencies."""
    tables = "\n".join(
        f"    {lift.boundary!r}: ({lift.table.low!r}, {lift.table.high!r}, {lift.table.power!r},"
        f" {lift.table.w_low!r}, {lift.table.per_w!r},\n        {tuple(lift.table.value.tolist())!r},\n       "
        f" {tuple(lift.table.slope.tolist())!r}),"
        for lift in export.lifts
    )
    return MODULE.format(about=_about(export), tables=tables, formulas=_formulas(export))


def casadi(export: ModelExport) -> str:
    """Source of the CasADi module; boundaries whose model has no closed form are left out."""
    ranges = "\n".join(
        f"    {lift.boundary!r}: ({lift.table.low!r}, {lift.table.high!r}, {lift.table.power!r}),"
        for lift in export.lifts
        if lift.closed is not None
    )
    return CASADI.format(about=_about(export), ranges=ranges, formulas=_formulas(export))
