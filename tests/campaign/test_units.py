"""Units become SI once, and a unit that cannot be meant is refused with the ones that can."""

import math
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nearlift import units
from nearlift.errors import ManifestError


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("23 mm", "length", 0.023),
        ("23mm", "length", 0.023),
        (" .5e-3 m ", "length", 5e-4),
        ("-0.2 mm", "length", -2e-4),
        ("1 in", "length", 0.0254),
        ("1 kgf", "force", 9.80665),
        ("1.5 gf", "force", 0.014709975),
        ("1 ozf", "force", 0.27801385),
        ("27 g", "mass", 0.027),
        ("20 degC", "temperature", 293.15),
        ("68 degF", "temperature", 293.15),
        ("1013.25 hPa", "pressure", 101325.0),
        ("50 percent", "fraction", 0.5),
        ("50 %", "fraction", 0.5),
        ("0.5 fraction", "fraction", 0.5),
        ("0.5", "fraction", 0.5),
        ("1.2 kg/m^3", "density", 1.2),
        ("3 deg", "angle", math.radians(3)),
        ("1 kHz", "frequency", 1000.0),
        ("60 rpm", "rotation", 1.0),  # turns, not radians: pint alone makes this 6.28
        ("16700 rpm", "rotation", 278.333333),
        ("1500 us", "throttle", 0.5),
        ("30 percent", "throttle", 0.3),
        ("0.3", "throttle", 0.3),
        ("6.283185307 rad/s", "rotation", 1.0),
    ],
)
def test_quantity(text, dimension, value):
    assert units.quantity(text, dimension, "key") == pytest.approx(value, rel=1e-8)


@pytest.mark.parametrize(
    ("text", "dimension", "told"),
    [
        (
            23,
            "length",
            r'^rig\.x: 23 has no unit\n  write it as text with a unit, such as "23 mm"$',
        ),
        (None, "length", "None has no unit"),
        (True, "mass", 'True has no unit\n  write it as text with a unit, such as "1 kg"'),
        ("23", "length", r"'23' is not a number with a unit"),
        ("mm", "length", r"'mm' is not a number with a unit"),
        ("nan mm", "length", r"'nan mm' is not a number with a unit"),
        ("1,5 mm", "length", "'1,5 mm' has a decimal comma\n  write decimals with a point"),
        ("1e400 mm", "length", "'1e400 mm' is not finite"),
        ("1 kg", "force", "'kg' is not a unit of force\n  use one of: N, mN, gf, kgf, lbf, ozf"),
        ("1 g", "force", "'g' is not a unit of force"),
        ("1 us", "fraction", "'us' is not a unit of fraction"),
        ("1 ms", "throttle", "is not a unit of throttle\n  use one of: fraction, percent, us"),
        (
            "1 furlongs2",
            "length",
            "unknown unit 'furlongs2'\n  a length is needed; use one of: mm, cm, m, in, um",
        ),
        ("5 N", "length", "'N' is not a unit of length\n  use one of: mm, cm, m, in, um"),
        ("1 count", "force", "'count' is not a unit of force"),
        ("5 m", "rotation", "'m' is not a unit of rotation\n  use one of: Hz, rev/s"),
    ],
)
def test_refusal_says_what_would_have_been_right(text, dimension, told):
    with pytest.raises(ManifestError, match=told):
        units.quantity(text, dimension, "rig.x")


@given(value=st.floats(-1e6, 1e6))
def test_to_si_is_linear(value):
    factor, offset = units.to_si("degC", "temperature", "key")
    assert factor * value + offset == pytest.approx(value + 273.15)
    factor, offset = units.to_si("mN", "force", "key")
    assert (factor, offset) == (pytest.approx(1e-3), 0.0)


def test_plausible_unit_of_a_bare_number():
    assert units.plausible(525, "length", 0.01, 1.5) == ["mm"]
    assert units.plausible(57, "length", 0.01, 1.5) == ["mm", "cm", "in"]
    assert units.plausible(92, "fraction", 0.0, 1.0) == ["percent"]
    assert units.plausible(1e9, "length", 0.01, 1.5) == []
    assert units.plausible(1.0, "mass", 0.0, 10.0) == []  # nothing usual is listed for it


@pytest.mark.parametrize(
    ("unit", "dimension"),
    [own for own in units.COMMON if own != ("us", "throttle")],
    ids=lambda v: str(v),
)
def test_common_units_are_pints(monkeypatch: pytest.MonkeyPatch, unit: str, dimension: str) -> None:
    want = units.COMMON[unit, dimension]
    monkeypatch.setattr(units, "COMMON", {})
    units._to_si.cache_clear()
    try:
        assert units.to_si(unit, dimension, "here") == want
    finally:
        units._to_si.cache_clear()


def test_a_usual_manifest_does_not_load_pint() -> None:
    use = 'units.quantity("23 mm", "length", "k"); units.to_si("degC", "temperature", "k")'
    program = f'import sys; from nearlift import units; {use}; print("pint" in sys.modules)'
    assert (
        subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, check=True
        ).stdout
        == "False\n"
    )
