"""The quoted result: its interval is that of its posterior."""

from __future__ import annotations

import dataclasses

import pytest
from tests.unit.simulated import campaign

from nearlift import catalogue
from nearlift.fit.posterior import sample
from nearlift.loop.diagnose import diagnose
from nearlift.loop.result import SAME_END, with_posterior
from nearlift.loop.search_problem import Options


@pytest.mark.parametrize(
    ("gain", "apart"), [(None, 0.05), (lambda c: (c["supply_V"] / 3.8) ** 2, 0.1)]
)
def test_the_quoted_interval_is_that_of_its_posterior(gain, apart):
    """Without and with supply sag; the exact grid has no sampling error.

    With an effect the quoted interval also covers the answer of its exact form.
    """
    data = campaign(5, visits=8, gain=gain)
    found = diagnose(data, catalogue.model("sanchez_cuevas"), (), Options(), confirm=False)
    quoted = found.quoted.coefficients["K_b"]
    assert found.quoted.effects == (() if gain is None else ("supply_sag",))
    corrections = [line.source for line in quoted.budget if "supply_sag" in line.source]
    assert corrections == ([] if gain is None else ["size and form of supply_sag"])
    drawn = sample(found.density, 0, "quoted", ess=400)
    low, high = drawn.quantiles(0, (0.05, 0.95))
    assert low == pytest.approx(quoted.lo90, abs=apart * quoted.u)
    assert high == pytest.approx(quoted.hi90, abs=apart * quoted.u)
    # a larger difference is stated
    held = with_posterior(found.quoted, drawn).coefficients["K_b"].holds
    same = max(abs(low - quoted.lo90), abs(high - quoted.hi90)) <= SAME_END * quoted.u
    assert (held == quoted.holds) == same
    moved = {"K_b": dataclasses.replace(quoted, hi90=quoted.hi90 + 0.06 * quoted.u)}
    stated = with_posterior(dataclasses.replace(found.quoted, coefficients=moved), drawn)
    assert "Posterior " in stated.coefficients["K_b"].holds
