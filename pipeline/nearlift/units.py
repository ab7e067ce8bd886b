"""The one place that knows millimetres, gram-force and percent.

Everything inside nearlift is float SI; quantities become SI here, once, when a manifest, a schedule
or a record is read. pint does the conversions and is imported only then (it takes 0.3 s).
"""

from __future__ import annotations

import functools
import math
import re
from typing import TYPE_CHECKING, Any

from nearlift.errors import ManifestError, brief

if TYPE_CHECKING:
    import pint

#: Units a lab is likely to have meant, in the order in which they are proposed.
USUAL = {
    "length": ("mm", "cm", "m", "in", "um"),
    "force": ("N", "mN", "gf", "kgf", "lbf", "ozf"),
    "torque": ("N*m", "mN*m"),
    "fraction": ("fraction", "percent"),
    "throttle": ("fraction", "percent", "us"),
    "rotation": ("rpm", "Hz", "rad/s"),
}

#: Turns per second in one of each. Apart from pint, to which a turn is 2 pi radians and a radian is
#: 1, so that "rpm" in "Hz" is 0.105 and not 1/60.
ROTATION = {
    "Hz": 1.0,
    "rev/s": 1.0,
    "rps": 1.0,
    "rpm": 1 / 60,
    "rev/min": 1 / 60,
    "1/min": 1 / 60,
    "rad/s": 1 / (2 * math.pi),
}

#: Factors to SI of the units that most manifests use, so that most runs need not load pint (0.5 s:
#: docs/decisions.md#units-and-compiled-code). A test holds them equal to pint's.
_FACTORS = {
    "length": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254, "um": 1e-6},
    "mass": {"kg": 1.0, "g": 1e-3},
    "time": {"s": 1.0, "ms": 1e-3},
    "force": {"N": 1.0, "mN": 1e-3, "gf": 9.80665e-3, "kgf": 9.80665},
    "frequency": {"Hz": 1.0, "kHz": 1e3},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "current": {"A": 1.0},
    "power": {"W": 1.0},
    "torque": {"N*m": 1.0, "mN*m": 1e-3},
    "temperature": {"K": 1.0, "degC": 1.0},
    "pressure": {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3},
    "density": {"kg/m^3": 1.0},
    "acceleration": {"m/s^2": 1.0},
    "angle": {"rad": 1.0, "deg": math.pi / 180},
    "fraction": {"fraction": 1.0, "percent": 1e-2},
    "velocity": {"m/s": 1.0},
    "inertia": {"kg*m^2": 1.0},
    "proportional gain": {"1/m/s": 1.0},
    "derivative gain": {"1/m": 1.0},
    "integral gain": {"1/m/s^2": 1.0},
}
#: Dimension -> the SI unit that carries it inside nearlift: the first of its factors.
SI = {dimension: next(iter(factors)) for dimension, factors in _FACTORS.items()} | {
    "rotation": "Hz",
    "fraction": "dimensionless",
    "throttle": "dimensionless",
}
#: (unit, dimension) -> factor and offset to SI.
COMMON = {
    (unit, dimension): (factor, 273.15 if unit == "degC" else 0.0)
    for dimension, factors in _FACTORS.items()
    for unit, factor in factors.items()
}
# a servo's pulse: idle at 1000 us, full at 2000 us
COMMON |= {(u, "throttle"): COMMON[u, "fraction"] for u in ("fraction", "percent")}
# numbers that are in SI already
COMMON |= {(SI[d], d): (1.0, 0.0) for d in ("fraction", "throttle")}
COMMON["us", "throttle"] = (1e-3, -1.0)

#: A decimal number as people and instruments write it.
NUMBER = re.compile(r"[-+]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][-+]?\d++)?")
#: A product of powers such as `kg*m^2/s`: what raises a number, or a power once more, is no unit,
#: and would be computed before it is refused.
_UNIT = re.compile(
    r"(?:[^\W\d]\w{0,30}+(?:\s?(?:\^|\*\*)\s?[-+]?\d{1,2})?+|\d{1,6}+(?!\s?(?:\^|\*\*))|\*(?!\*)|[%°/·⋅()\s])*+"
)
UNIT_LENGTH = 80


@functools.cache
def registry() -> pint.UnitRegistry[Any]:
    """The unit registry: pint's own units and `fraction`."""
    import pint

    units: pint.UnitRegistry[Any] = pint.UnitRegistry(
        cache_folder=None, autoconvert_offset_to_baseunit=True
    )
    units.define("fraction = 1")
    return units


def to_si(unit: str, dimension: str, where: str) -> tuple[float, float]:
    """Factor and offset that take a number in `unit` to SI: ``si = factor * number + offset``.

    Raises
    ------
    ManifestError
        The unit is unknown, or is not one of `dimension`.
    """
    return _to_si(unit.strip(), dimension, where)


def usual(dimension: str) -> tuple[str, ...]:
    """The units of a dimension in the order in which they are proposed."""
    return USUAL.get(dimension, (SI[dimension],))


@functools.cache
def _to_si(unit: str, dimension: str, where: str) -> tuple[float, float]:
    target, choices = SI[dimension], ", ".join(usual(dimension))
    if dimension == "rotation":
        if unit not in ROTATION:
            raise ManifestError(
                where,
                f"{brief(repr(unit))} is not a unit of rotation",
                f"use one of: {', '.join(ROTATION)}",
            )
        return ROTATION[unit], 0.0
    if (unit, dimension) in COMMON:
        return COMMON[unit, dimension]
    unknown = ManifestError(
        where,
        f"unknown unit {brief(repr(unit))}",
        f"a {dimension} is needed; use one of: {choices}",
    )
    if len(unit) > UNIT_LENGTH or not _UNIT.fullmatch(unit):
        raise unknown
    import pint

    units = registry()
    try:
        zero = units.Quantity(0.0, unit).to(target).magnitude
        one = units.Quantity(1.0, unit).to(target).magnitude
    except pint.DimensionalityError:
        raise ManifestError(
            where, f"{unit!r} is not a unit of {dimension}", f"use one of: {choices}"
        ) from None
    except Exception:  # pint raises many kinds on a malformed unit text
        raise unknown from None
    factor = one - zero
    return (float(factor), 0.0) if abs(zero) < 1e-12 * abs(factor) else (float(factor), float(zero))


def measure(text: str) -> tuple[float | None, str]:
    """The number that a text begins with, None without one, and what follows it."""
    plain = text.strip()
    number = NUMBER.match(plain)
    return (float(number[0]), plain[number.end() :].lstrip()) if number else (None, plain)


def quantity(text: object, dimension: str, where: str) -> float:
    """SI value of a text such as ``"23 mm"``.

    Raises
    ------
    ManifestError
        `text` is not a number with a unit, or its unit is not one of `dimension`.
    """
    example = {"length": "23 mm", "force": "1.5 gf", "time": "2 s", "frequency": "1000 Hz"}.get(
        dimension, f"1 {SI[dimension]}"
    )
    if not isinstance(text, str):
        raise ManifestError(
            where,
            f"{brief(repr(text))} has no unit",
            f'write it as text with a unit, such as "{example}"',
        )
    value, unit = measure(text)
    if value is None or (not unit and SI[dimension] != "dimensionless"):
        raise ManifestError(
            where, f"{brief(repr(text))} is not a number with a unit", f'write it as "{example}"'
        )
    if unit[:1] == "," and unit[1:2].isdigit():
        raise ManifestError(
            where, f"{brief(repr(text))} has a decimal comma", "write decimals with a point"
        )
    factor, offset = to_si(unit or "fraction", dimension, where)
    result = factor * value + offset
    if not math.isfinite(result):
        raise ManifestError(where, f"{brief(repr(text))} is not finite", "write a finite number")
    return result


def plausible(value: float, dimension: str, low: float, high: float) -> list[str]:
    """The usual units in which the bare number `value` would lie within [`low`, `high`] (SI)."""
    fitting = []
    for unit in USUAL.get(dimension, ()):
        factor, offset = to_si(unit, dimension, "")
        if low <= factor * value + offset <= high:
            fitting.append(unit)
    return fitting
