"""Effects that a boundary's trials can show, with the sizes of their bench."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.unit.simulated import GROUND, campaign

from nearlift import catalogue
from nearlift.likelihood.covariates import derive
from nearlift.loop.admission import effects_to_test
from nearlift.loop.diagnose import Options, diagnose


def test_a_zero_drift_of_a_large_rig_is_named() -> None:
    """0.1 N where lift is 2 to 7 N: 2.5 times what a cell of 1 kgf is given."""
    data = campaign(3, relative=0.003, height=0.0)
    start = data.covariates["start_s"]
    since = start - np.array([start[data.session == k].min() for k in range(5)])[data.session]
    lift = 12 * data.lift_N + 0.1 * -np.expm1(-since / 400)
    large = dataclasses.replace(data, lift_N=lift, u_lift_N=12 * data.u_lift_N)
    answer = diagnose(large, GROUND, (), Options(seed=1), confirm=False).quoted
    assert answer.effects == ("zero_drift",)
    (size,) = (s for s in answer.sizes if s.parameter == "zero_drift_N")
    assert size.value == pytest.approx(0.1, abs=0.02)


def test_zero_errors_grow_with_the_lift_of_the_rig() -> None:
    data = campaign(3)
    for factor, wanted in ((1.0, 1.0), (12.0, 12 * np.median(data.lift_N))):
        rig = dataclasses.replace(data, lift_N=factor * data.lift_N)
        rig = derive(rig, rig.lift_N, np.ones(rig.n))
        known = {e.name: e for e in effects_to_test(rig, GROUND)[0]}
        declared = catalogue.effect("zero_temperature").parameters[0]
        (size,) = known["zero_temperature"].parameters
        np.testing.assert_allclose(size.bounds, np.multiply(wanted, declared.bounds))
        np.testing.assert_allclose(size.prior.scale, wanted * declared.prior.scale)
        assert known["zero_offset"] is catalogue.effect("zero_offset")
