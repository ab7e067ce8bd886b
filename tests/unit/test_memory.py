"""What a fit and a diagnosis hold at once grows with the trials, not with their square."""

import dataclasses
import tracemalloc

import numpy as np
import pytest

from nearlift import catalogue
from nearlift.diagnosis import loop
from nearlift.fitting import collapse, gum, least_squares, predictive, profiles
from nearlift.fitting.noise import MOST_CELLS, estimate
from nearlift.stages import beside, expense

from .simulated import campaign

GROUND = catalogue.model("sanchez_cuevas")
#: Trials are made four times as many; memory in proportion makes four of a peak, memory in their square sixteen.
SEVERAL, LINEAR = 4, 5.0


def scattered(data, stops=None):
    """Every visit at a height of its own, or at one of so many."""
    rng = np.random.default_rng(5)
    moved = np.exp(0.05 * rng.normal(size=data.visit.max() + 1))
    return dataclasses.replace(data, z_hat=data.z_hat * moved[data.visit % stops if stops else data.visit])


def fitted(data):
    found = least_squares.fit(GROUND, data)
    profiles.of(found)
    predictive.leave_visit_out(found)
    gum.of(found)
    collapse.examine(*beside.linearised(found), lambda g: gum.freedom(found.problem, g, found.parts, found.noise, found.slope))


def diagnosed(data):
    stage, _, _ = loop.set_up(data, GROUND, (), loop.Options())
    assert stage.nothing_added[0].p_value > 0


def peak(work, data):
    tracemalloc.start()
    try:
        work(data)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("work", [fitted, diagnosed])
@pytest.mark.parametrize("place", [lambda data: data, scattered], ids=["stations", "scattered heights"])
def test_four_times_the_trials_take_no_more_than_five_times_the_memory(work, place):
    few, many = (place(campaign(2, visits=visits)) for visits in (15, 15 * SEVERAL))
    # what is imported, compiled or tabulated once belongs to neither
    work(few)
    assert peak(work, many) < LINEAR * peak(work, few)


def test_where_cells_are_too_many_repeats_are_taken_from_the_stations_visited_most():
    data = scattered(campaign(3, visits=45), stops=150)
    noise = estimate(data, GROUND, {"K_b": 2.0})
    assert len(np.unique(data.z_hat)) * 4 > MOST_CELLS
    assert "scatter of repeats" in noise.source
    assert noise.dof <= data.n - MOST_CELLS
    assert noise.relative == pytest.approx(0.004, rel=0.25)


@pytest.mark.parametrize("law", [expense.FIT, expense.DIAGNOSE])
def test_what_takes_long_is_told_with_trials_time_and_memory(law):
    told = []
    usual, large = campaign(4, visits=30), campaign(4, visits=900)
    expense.announce(told.append, "fit ground", law, usual)
    assert told == []
    expense.announce(told.append, "fit ground", law, large)
    [line] = told
    seconds, megabytes = law.of(large)
    assert line == f"fit ground: 36000 trials, about {seconds:.0f} s and {megabytes / 1000:.1f} GB"
    # where no two trials share a distance, the model is asked at every trial
    assert law.of(dataclasses.replace(large, z_hat=np.geomspace(1.2, 12, large.n)))[0] >= seconds
