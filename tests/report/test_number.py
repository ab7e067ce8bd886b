"""A number of the page has the decimals of its uncertainty, and says where it stands."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from nearlift.report.number import Place
from nearlift.stages.fit import RESULTS


def place(content: object) -> Place:
    return Place(SimpleNamespace(document=lambda _: {"K_b": content}), RESULTS, ("K_b",))


@pytest.mark.parametrize(
    ("entry", "show", "value", "u", "interval"),
    [
        ({"value": 2.01234, "u": 0.0512, "lo90": 1.9281, "hi90": 2.0965}, float, "2.01", "0.05", "1.93 to 2.10"),
        # without u, the width of the interval says to how many digits
        ({"value": 2.01234, "lo90": 1.9281, "hi90": 2.0965}, float, "2.01", None, "1.93 to 2.10"),
        # u is that of the stated unit, so the width counts in another
        ({"value": 0.00201234, "u": 0.0000512, "lo90": 0.0019281, "hi90": 0.0020965}, lambda m: 1e3 * m, "2.01", None, "1.93 to 2.10"),
        # nothing says to how many digits: six
        ({"value": 2.01234, "lo90": None, "hi90": None}, float, "2.01234", None, "– to –"),
        ({"value": 0.0, "lo90": None, "hi90": None}, float, "0.00000", None, "– to –"),
    ],
)  # fmt: skip
def test_an_estimate_has_the_decimals_of_its_uncertainty(entry, show, value, u, interval):
    quoted = place(entry).quote(show=show)
    assert str(quoted.value.text) == value
    if u is not None:
        assert quoted.u is not None
        assert quoted.u.text == u
    assert quoted.interval.striptags() == interval
    assert quoted.value.source == "results.json#/K_b/value"
    assert not quoted.at_bound


def test_degrees_of_freedom_have_a_decimal_where_it_matters():
    texts = [place(dof).degrees().text for dof in (3.24, 9.94, 9.96, 120.4, None)]
    assert texts == ["3.2", "9.9", "10", "120", "∞"]
    assert place(None).degrees().value == math.inf
