"""What would halve an uncertainty: the number printed, tried out."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.unit.simulated import campaign, hsiao

from nearlift import catalogue
from nearlift.fit import height_error, information
from nearlift.fit.least_squares import fit
from nearlift.likelihood.budget import Component
from nearlift.results import Noise
from nearlift.rounding import plain, signed

SCATTER = Noise(relative=0.002, force_N=1e-4)


def datum(standard):
    return Component(
        name="distance datum",
        on="height",
        standard=standard,
        distribution="normal",
        scope="boundary",
    )


def fitted(model="sanchez_cuevas", parts=(), visits=4, **kind):
    return fit(
        catalogue.model(model),
        campaign(3, visits=visits, **kind),
        parts,
        SCATTER,
        offset_m=0.0,
    )


def test_the_datum_that_would_halve_u_does():
    found = fitted(parts=(datum(1e-3),), visits=30)
    knowledge = information.halvings(found)["K_b"].knowledge
    one = next(r for r in knowledge if r.quantity == "distance datum")
    assert one.r > information.TRADES
    assert one.unit == "mm"
    assert f"K_b is confounded with the distance datum (r = {signed(one.r, 2)})." in one.text
    assert (
        f"Knowing the distance datum independently to {plain(one.needed, 2)} mm would halve u(K_b)"
        in one.text
    )
    # the same trials with that measurement added to the declared datum
    better = (1e-3**-2 + (one.needed / 1000) ** -2) ** -0.5
    again = fit(
        found.model,
        found.problem.data,
        (datum(better),),
        SCATTER,
        found.slope,
        0.0,
    )
    assert again.estimates["K_b"].u == pytest.approx(found.estimates["K_b"].u / 2, rel=0.02)
    exact = fit(found.model, found.problem.data, (), SCATTER, found.slope, 0.0)
    assert one.u_best == pytest.approx(exact.estimates["K_b"].u, rel=0.02)


def test_what_cannot_halve_it_says_how_far_it_would_go():
    found = fitted(parts=(datum(0.1e-3),), visits=2)
    (one,) = [
        r for r in information.halvings(found)["K_b"].knowledge if r.quantity == "distance datum"
    ]
    assert np.isnan(one.needed)
    assert (
        f"With exact distance datum, u(K_b) would be {one.u_best:.2g} instead of {one.u:.2g}"
        in one.text
    )
    assert "K_b correlates with the distance datum" in one.text


def test_a_coefficient_known_from_elsewhere():
    found = fitted("sanchez_cuevas_free_exponent")
    (one,) = [r for r in information.halvings(found)["K_b"].knowledge if r.quantity == "n"]
    assert one.r == pytest.approx(
        found.covariance[0, 1] / np.sqrt(np.prod(np.diag(found.covariance))), rel=1e-6
    )
    assert one.known_to == pytest.approx(found.estimates["n"].u, rel=1e-6)
    whole = np.linalg.inv(found.covariance) + np.diag([0, one.needed**-2])
    assert np.linalg.inv(whole)[0, 0] ** 0.5 == pytest.approx(
        found.estimates["K_b"].u / 2, rel=1e-4
    )


def test_all_levels_together():
    (one,) = [r for r in information.halvings(fitted())["K_b"].knowledge if r.quantity == "L_inf"]
    assert "correlates with the L_inf values (multiple r = " in one.text
    assert one.unit == "%"


def test_so_many_repeats_halve_it():
    found = fitted(parts=(datum(0.02e-3),))
    repeats = information.halvings(found)["K_b"].repeats
    assert repeats.times > 4
    n = round(repeats.times)
    data = found.problem.data
    many = dataclasses.replace(
        data.take(np.tile(np.arange(data.n), n)),
        visit=np.concatenate([data.visit + k * 1000 for k in range(n)]),
    )
    again = fit(found.model, many, (datum(0.02e-3),), SCATTER, np.tile(found.slope, n), 0.0)
    assert again.estimates["K_b"].u == pytest.approx(found.estimates["K_b"].u / 2, rel=0.06)
    assert (
        repeats.text
        == f"{plain(repeats.times, 3)} times the trials, in the same design, would halve u(K_b)"
    )


def test_no_number_of_repeats_undoes_a_bent_line():
    """A session's gain by distance would average, the cell's one line never does."""
    line = Component(
        name="load cell linearity",
        on="linearity",
        standard=0.05,
        distribution="uniform",
        scope="campaign",
        range_N=1.0,
    )
    gain = Component(
        name="gain at each station",
        on="gain",
        standard=0.01,
        distribution="normal",
        scope="distance",
    )
    found = fitted(parts=(line, gain), visits=30)
    repeats = information.halvings(found)["K_b"].repeats
    assert repeats.times == np.inf
    assert "No number of repeats would halve u(K_b)" in repeats.text


def test_a_height_error_is_among_them():
    data = campaign(
        3,
        boundary="ceiling",
        ratio=hsiao,
        stations=(0.1, 0.15, 0.2, 0.3, 0.5, 1.0, 10.0),
        datum=5e-4,
        visits=6,
    )
    found = fit(catalogue.model("hsiao_chirarattananon"), data, (datum(5e-4),), SCATTER)
    u = height_error.u_m(found.problem, found.theta, found.slope, 5e-4)
    halving = information.halvings(found)["alpha"]
    one = next(r for r in halving.knowledge if r.quantity == "distance datum")
    assert one.known_to == pytest.approx(1000 * u, rel=1e-3)
    assert one.u == pytest.approx(found.estimates["alpha"].u)
    assert halving.repeats.times > 1


def test_nothing_is_said_of_what_is_not_determined():
    assert information.halvings(fitted(stations=(2.0,))) == {}
