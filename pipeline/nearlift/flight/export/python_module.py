"""Python source of a fitted lift model: a module without dependencies."""

from __future__ import annotations

from nearlift.flight.export.model_export import ExportedLift, ModelExport

MODULE = '''"""{about}

ratio(boundary, z_hat) returns (L / L_inf, flag); it reads a table of cubic pieces in 1 / (1 + z_hat).
"""

# boundary: lowest and highest z_hat, power of the fall beyond it, first node, nodes per unit of w, values, slopes per piece
TABLES = {{
{tables}
}}


def _clamp(z_hat, low, high):
    if z_hat != z_hat:
        return high, 2
    return (high, 1) if z_hat > high else (low, -1) if z_hat < low else (z_hat, 0)


def _beyond(ratio, z_hat, high, power, flag):
    # farther than measured, the ratio less 1 fades as the inverse square of distance
    if flag != 1:
        return 1.0 if flag == 2 else ratio
    s = z_hat / high - 1
    return 1 + (ratio - 1) / (1 + s * (power + s))


def ratio(boundary, z_hat):
    """L / L_inf and its flag: 0 within the measured range, -1 nearer, +1 farther, 2 for NaN."""
    low, high, power, first, per_w, value, slope = TABLES[boundary]
    z, flag = _clamp(z_hat, low, high)
    x = max((1 / (1 + z) - first) * per_w, 0.0)
    i = min(int(x), len(value) - 2)
    t = min(x - i, 1.0)
    a, p, q = value[i], slope[i], slope[i + 1]
    d = value[i + 1] - a
    found = a + t * (p + t * ((3 * d - 2 * p - q) + t * (p + q - 2 * d)))
    return _beyond(found, z_hat, high, power, flag), flag
'''


def module(export: ModelExport) -> str:
    """Source text of the module."""
    # the header comment becomes a docstring, which quotes or backslashes could end
    about = "\n".join(export.about()).replace("\\", "/").replace('"', "'")
    return MODULE.format(
        about=about, tables="\n".join(_entry(*item) for item in export.boundaries.items())
    )


def _entry(boundary: str, lift: ExportedLift) -> str:
    t = lift.table
    numbers = f"{t.low!r}, {t.high!r}, {t.power!r}, {t.w_low!r}, {t.per_w!r}"
    value, slope = tuple(t.value.tolist()), tuple(t.slope.tolist())
    return f"    {boundary!r}: ({numbers},\n        {value!r},\n        {slope!r}),"
