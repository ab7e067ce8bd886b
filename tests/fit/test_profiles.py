"""Profile likelihoods: parabolas where the model is linear, lmfit's own profiles where it is not,
open ends at bounds.
"""

from __future__ import annotations

import dataclasses

import lmfit
import numpy as np
import pytest
from tests.unit.simulated import campaign, hsiao

from nearlift import catalogue
from nearlift.fit import profiles
from nearlift.fit.least_squares import fit
from nearlift.results import Noise

SCATTER = Noise(relative=0.01)


def profile(model, data, parts=(), scatter=SCATTER, **more):
    found = fit(catalogue.model(model), data, parts, scatter, **more)
    return found, profiles.likelihood_profiles(found)


def width(profile, level):
    return getattr(profile.ends, f"hi{level}") - getattr(profile.ends, f"lo{level}")


def test_two_coefficients_against_lmfit():
    """The same chi2 profiled by lmfit's `conf_interval`, one fit per step."""
    data = campaign(3, visits=1, ratio=lambda z: 1 + 0.2 * np.exp(-0.5 * z))
    found, own = profile("power_law", data)
    problem = found.problem
    parameters = lmfit.Parameters()
    for name, value, q in zip(found.names, found.theta, problem.model.parameters, strict=True):
        parameters.add(name, value=value, min=q.bounds[0], max=q.bounds[1])
    minimiser = lmfit.Minimizer(
        lambda v: problem.residuals(np.array([v[n].value for n in found.names])),
        parameters,
        scale_covar=False,
    )
    result = minimiser.minimize()

    def rise(out, best):
        # its own measure is an F test with chi2 as the noise; ours knows the noise
        return float(np.sqrt(max(out.chisqr - best.chisqr, 0.0)))

    ends = lmfit.conf_interval(
        minimiser,
        result,
        sigmas=[1.9599639845],
        prob_func=lambda best, out: _chance(rise(out, best)),
    )
    for name, rows in ends.items():
        low, high = rows[0][1], rows[-1][1]
        assert (own[name].ends.lo95, own[name].ends.hi95) == pytest.approx(
            (low, high), abs=0.01 * found.estimates[name].u
        )


def _chance(z):
    from scipy.special import erf

    return float(erf(z / np.sqrt(2)))


def test_an_end_beyond_a_bound_is_open():
    """Lift that falls towards the ceiling wants alpha below zero: the profile starts at the bound
    and has no lower end.
    """
    data = campaign(
        4,
        boundary="ceiling",
        ratio=lambda z: hsiao(z, 0.0),
        stations=(0.3, 0.6, 1.0, 5.0),
        visits=2,
    )
    _, own = profile(
        "hsiao_chirarattananon",
        dataclasses.replace(data, lift_N=data.lift_N * np.where(data.z_hat < 0.5, 0.999, 1.0)),
    )
    alpha = own["alpha"]
    assert alpha.value[0] == pytest.approx(0, abs=1e-8)
    assert np.isnan(alpha.ends.lo95)
    assert np.isfinite(alpha.ends.hi95)


def test_a_profile_that_rises_slowly_is_followed_outwards():
    """Three stations and 3 % of noise: an amplitude thirteen times its value is within 95 %, the
    lower end is as sharp as ever.
    """
    data = campaign(4, visits=1, stations=(1.5, 2.5, 11.0))
    found, own = profile("power_law", data, scatter=Noise(relative=0.03))
    a, u = own["a"], found.estimates["a"].u
    assert a.value[-1] > found.theta[0] + 10 * profiles.FIRST_REACH_U * u
    assert a.ends.hi95 > found.theta[0] + 40 * u
    low = np.linspace(found.theta[0] - 3 * u, found.theta[0], 301)
    p = np.linspace(*found.model.parameters[1].bounds, 2001)
    chi2 = np.array(
        [found.problem.chi2(np.stack([np.full_like(p, x), p], axis=1)).min() for x in low]
    )
    assert a.ends.lo95 == pytest.approx(np.interp(-3.8415, -(chi2 - chi2.min()), low), abs=0.02 * u)
    assert np.isnan(own["p"].ends.lo95)  # no exponent is too small


def test_student_widens_every_level():
    data = campaign(3, visits=4)
    _, known = profile("sanchez_cuevas", data)
    _, guessed = profile("sanchez_cuevas", data, scatter=Noise(relative=0.01, dof=6.0))
    from scipy.stats import norm, t

    for level in profiles.LEVELS:
        widths = [width(p["K_b"], level) for p in (known, guessed)]
        assert widths[1] / widths[0] == pytest.approx(
            t.ppf(0.5 + level / 200, 6) / norm.ppf(0.5 + level / 200), rel=0.05
        )


def test_what_is_not_determined_has_no_profile():
    data = campaign(3, visits=3, stations=(2.0,))
    assert profile("sanchez_cuevas", data)[1] == {}
