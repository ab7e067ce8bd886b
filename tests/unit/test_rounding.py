"""Numbers as they are printed."""

import pytest

from nearlift.rounding import decimals, plus_minus, siunitx


@pytest.mark.parametrize(
    ("value", "u", "text"),
    [
        (2.0561, 0.0812, "2.06(8)"),
        (2.0561, 0.0149, "2.056(15)"),
        (1234.5, 21.0, "1234(21)"),
        (-0.00123, 0.0004, "-0.0012(4)"),
        (3.0, float("nan"), "3"),
    ],
)
def test_siunitx(value, u, text):
    assert siunitx(value, u) == text


def test_rounding():
    assert decimals(0.0195) == 3
    assert decimals(0.0295) == 2
    assert decimals(0.098) == 2
    assert plus_minus(-0.0001, 0.02) == "0.000 ± 0.020"
    assert decimals(0.00257) == 4
    assert plus_minus(-4.2, 29.0) == "−4 ± 29"
