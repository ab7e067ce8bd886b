"""What a reduction to cells, a fit and a diagnosis hold at once grows with the trials, not with
their square.
"""

import tracemalloc
from dataclasses import fields, replace

import numpy as np
import pytest

from nearlift import catalogue
from nearlift.fit import collapse, deletion, least_squares, profiles
from nearlift.loop import diagnose as loop
from nearlift.loop import search
from nearlift.loop.candidate import Candidate
from nearlift.loop.search_problem import Options
from nearlift.reduction.lift_change import cells

from .simulated import GROUND, campaign, problem

#: Trials are made four times as many; memory in proportion makes four of a peak, memory in their
#: square sixteen.
SEVERAL, LINEAR = 4, 5.0


def scattered(data):
    """Every visit at a height of its own."""
    moved = np.exp(0.05 * np.random.default_rng(5).normal(size=data.visit.max() + 1))
    return replace(data, z_hat=data.z_hat * moved[data.visit])


def fitted(data):
    found = least_squares.fit(GROUND, data)
    profiles.likelihood_profiles(found)
    deletion.influence(found)
    collapse.examine(found)


def reduced(data):
    cells(data.z_hat, data.throttle, data.lift_N, data.u_lift_N, data.visit)


def diagnosed(data):
    assert problem(data).nothing_added[0].p_value > 0


def peak(work, data):
    tracemalloc.start()
    try:
        work(data)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("work", [reduced, fitted, diagnosed])
@pytest.mark.parametrize(
    "place", [lambda data: data, scattered], ids=["stations", "scattered heights"]
)
@pytest.mark.nightly
def test_four_times_the_trials_take_no_more_than_five_times_the_memory(work, place):
    few, many = (place(campaign(2, visits=visits)) for visits in (15, 15 * SEVERAL))
    # what is imported, compiled or tabulated once belongs to neither
    work(few)
    assert peak(work, many) < LINEAR * peak(work, few)


def in_sessions(sessions):
    data = campaign(6, visits=15, gain=lambda known: (known["supply_V"] / 4) ** 0.5)
    return replace(data, session=np.arange(data.n) * sessions // data.n)


def test_the_gains_of_all_sessions_are_differentiated_in_one_pass():
    """The derivatives, (trials, sessions), are the largest thing made; and they are those of one
    session at a time.
    """
    gain = catalogue.effect("session_gain")
    candidate = Candidate(base=GROUND, effects=(gain,), data=in_sessions(60))
    vector = np.r_[2.0, np.random.default_rng(7).normal(0, 0.01, 60)]
    jacobian = candidate.jacobian(vector)
    assert peak(lambda _: candidate.jacobian(vector), None) < 3 * jacobian.nbytes
    steps = 1e-5 * np.eye(61)
    by_hand = (candidate.log_ratio(vector + steps) - candidate.log_ratio(vector - steps)).T / 2e-5
    assert jacobian == pytest.approx(by_hand, rel=1e-6, abs=1e-9)


def test_what_a_search_keeps_of_a_candidate_grows_with_the_trials_and_not_with_trials_times_sessions():
    effects = tuple(catalogue.effect(name) for name in ("session_gain", "supply_sag"))
    stage, _, _ = loop.set_up(in_sessions(30), GROUND, (), Options(), effects)
    singles = search.run(stage).singles
    assert {e.name for e in singles} == {"session_gain", "supply_sag"}
    for kept in (*singles, *(e.fitted for e in singles)):
        values = (getattr(kept, f.name) for f in fields(kept))
        assert all(x.size <= stage.data.n for x in values if isinstance(x, np.ndarray))
