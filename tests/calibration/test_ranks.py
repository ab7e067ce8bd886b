"""Simulation-based calibration (Talts, Betancourt, Simpson, Vehtari and Gelman 2018): the truth is
drawn from a prior, records are simulated with it, and the library makes a posterior with the same
prior. Then the rank of the truth among the posterior's draws is uniform.

NEARLIFT_RANKS_N campaigns of each kind (200). A right engine fails here once in a thousand for each
boundary.
"""

import os
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chisquare, kstest
from tests.calibration import forms
from tests.calibration.simulator import Spec, simulate

from nearlift import catalogue
from nearlift.declare import uniform
from nearlift.fit import posterior
from nearlift.fit.density import Density
from nearlift.fit.least_squares import fit
from nearlift.results import Noise
from nearlift.run.workers import ordered

pytestmark = pytest.mark.calibration
N = int(os.environ.get("NEARLIFT_RANKS_N", "200"))
ALARM = 1e-3
#: Half-width of the prior, as a fraction of the nominal coefficient.
SPREAD = 0.6
MODELS = {"ground": "sanchez_cuevas", "ceiling": "hsiao_chirarattananon"}


def rank(job):
    """Share of the posterior's draws below the truth, and whether the central 90 % hold it. The
    library is given that part of the true noise; where it is None it estimates the noise.
    """
    boundary, seed, part = job
    spec = Spec(boundary=boundary, spread=SPREAD, realism=False, visits=4, samples=120)
    campaign = simulate(spec, seed)
    model = catalogue.model(MODELS[boundary])
    parameter = model.parameters[0]
    nominal = forms.COEFFICIENTS[boundary][parameter.name]
    ends = nominal * (1 - SPREAD), nominal * (1 + SPREAD)
    flat = replace(parameter, prior=uniform(*ends), bounds=ends, value=nominal)
    noise = None
    if part is not None:
        true = campaign.truth.scatter
        noise = Noise(**{k: part * getattr(true, k) for k in ("relative", "force_N", "height_m")})
    fitted = fit(replace(model, parameters=(flat,)), campaign.data, scatter=noise)
    density = Density(problem=fitted.problem, centre=fitted.theta, dof=fitted.effective.min())
    drawn = posterior.sample(density, seed, boundary, ess=1000, chain=False).theta.ravel()
    truth = campaign.truth.theta[parameter.name]
    low, high = np.quantile(drawn, [0.05, 0.95])
    return float(np.mean(drawn < truth)), bool(low <= truth <= high)


def ranks(executor, boundary, part):
    """p-value that the ranks are uniform (the smaller of chi-square over bins and
    Kolmogorov-Smirnov, doubled), and how many intervals hold the truth.
    """
    jobs = [(boundary, seed, part) for seed in range(70_000, 70_000 + N)]
    shares, inside = map(np.array, zip(*ordered(executor, rank, jobs), strict=True))
    count = np.histogram(shares, 10, (0, 1))[0]
    p = min(1.0, 2 * min(chisquare(count).pvalue, kstest(shares, "uniform").pvalue))
    print(
        f"{MODELS[boundary]}, noise {part}: p = {p:.3g}, {inside.sum()} of {N} hold, bins {count}"
    )
    return p, inside.sum()


@pytest.mark.parametrize("boundary", MODELS)
@pytest.mark.parametrize("part", [1.0, None])
def test_the_truth_ranks_uniformly_among_the_draws(executor, boundary, part):
    p, inside = ranks(executor, boundary, part)
    assert p > ALARM
    assert binom.ppf(ALARM / 2, N, 0.9) <= inside <= binom.ppf(1 - ALARM / 2, N, 0.9)


@pytest.mark.parametrize("boundary", MODELS)
def test_trials_taken_for_twice_as_good_do_not(executor, boundary):
    """The test must notice a wrong likelihood."""
    p, inside = ranks(executor, boundary, 0.5)
    assert p < ALARM
    assert inside < binom.ppf(ALARM / 2, N, 0.9)
