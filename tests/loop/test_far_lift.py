"""L_inf by the accepted model, in the average conditions of its trials."""

from __future__ import annotations

import numpy as np
import pytest
from tests.unit import simulated

from nearlift import catalogue
from nearlift.loop.diagnose import diagnose
from nearlift.loop.search_problem import Options


@pytest.mark.parametrize(("visits", "more"), [(4, ()), (1, (1.2, 2.5))])
def test_a_sag_that_is_named_leaves_l_inf_known_at_the_supply_of_each_throttle(visits, more):
    """Lift sags by 13 % over a session; L_inf is known to 0.3 %, with few visits too."""
    stations = (*simulated.STATIONS, *more)
    data = simulated.campaign(
        3, visits=visits, stations=stations, gain=lambda c: (c["supply_V"] / 3.7) ** 2
    )
    base = catalogue.model("sanchez_cuevas")
    findings = diagnose(data, base, (), Options(), confirm=False).findings
    assert "supply_sag" in [e.name for e in findings.effects]
    for throttle, far in findings.L_inf_N.items():
        supply = data.covariates["supply_V"][data.throttle == throttle]
        truth = simulated.L_INF[throttle] * np.exp(2 * np.log(supply / 3.7).mean())
        assert 0.0002 < far.u / far.value < 0.003
        assert far.value == pytest.approx(truth, abs=4 * far.u)
