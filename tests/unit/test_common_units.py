"""The units that do not load pint are pint's to the last bit, and a turn is a turn."""

from __future__ import annotations

import subprocess
import sys

import pytest

from nearlift import units
from nearlift.errors import ManifestError


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


@pytest.mark.parametrize(
    ("unit", "turns"),
    [("rpm", 1 / 60), ("Hz", 1.0), ("rad/s", 0.15915494309189535), ("1/min", 1 / 60)],
)
def test_a_rotation_is_in_turns(unit: str, turns: float) -> None:
    assert units.to_si(unit, "rotation", "k") == (turns, 0.0)


def test_an_unknown_rotation_is_refused() -> None:
    with pytest.raises(
        ManifestError, match="'kph' is not a unit of rotation\n  use one of: Hz, rev/s"
    ):
        units.to_si("kph", "rotation", "k")
