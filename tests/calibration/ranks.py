"""Simulation-based calibration: where the truth ranks among the draws of its posterior, over many
campaigns from records.

The truth is drawn from a prior, records are simulated by the referee with that truth, and the
library makes a posterior with the very same prior. If everything in between is right, the rank of
the truth is uniform (Talts, Betancourt, Simpson, Vehtari and Gelman 2018).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from tests.calibration import forms
from tests.calibration.simulator import Campaign, Spec, simulate

from nearlift import catalogue
from nearlift.declare import LiftModel, uniform
from nearlift.fit import posterior
from nearlift.fit.density import Density
from nearlift.fit.least_squares import fit
from nearlift.results import Noise

SPREAD = 0.6
BINS = 10
MODELS = {"ground": "sanchez_cuevas", "ceiling": "hsiao_chirarattananon"}


@dataclass(frozen=True, kw_only=True)
class Rank:
    """Share of the posterior's draws below the truth, and whether the central 90 % held it."""

    share: float
    inside90: bool


def believed(boundary: str) -> LiftModel:
    """The base model with the prior that the simulator draws its truth from: flat within +- SPREAD
    of the nominal coefficient.
    """
    model = catalogue.model(MODELS[boundary])
    parameter = model.parameters[0]
    nominal = forms.COEFFICIENTS[boundary][parameter.name]
    ends = sorted((nominal * (1 - SPREAD), nominal * (1 + SPREAD)))
    return replace(
        model,
        parameters=(
            replace(parameter, prior=uniform(*ends), bounds=(ends[0], ends[1]), value=nominal),
        ),
    )


def from_repeats(campaign: Campaign) -> None:
    """The noise is left to the library."""


def true(campaign: Campaign) -> Noise:
    """The noise that was put in."""
    scatter = campaign.truth.scatter
    return Noise(relative=scatter.relative, force_N=scatter.force_N, height_m=scatter.height_m)


def half(campaign: Campaign) -> Noise:
    """A wrong likelihood: trials are believed to be twice as good as they are."""
    true = campaign.truth.scatter
    return Noise(relative=true.relative / 2, force_N=true.force_N / 2, height_m=true.height_m / 2)


Told = Callable[[Campaign], Noise | None]


def rank(job: tuple[str, int, Told]) -> Rank:
    """One campaign of a boundary and seed; the third says what the library is told of its noise,
    None to let it look for itself.
    """
    boundary, seed, noise = job
    found = simulate(
        Spec(boundary=boundary, spread=SPREAD, realism=False, visits=4, samples=120), seed
    )
    model = believed(boundary)
    fitted = fit(model, found.data, scatter=noise(found))
    density = Density(problem=fitted.problem, centre=fitted.theta, dof=fitted.dof_of_all)
    settings = posterior.Settings(ess=1000)
    drawn = posterior.sample(density, settings, seed, boundary, chain=False).flat()[:, 0]
    truth = found.truth.theta[model.parameters[0].name]
    low, high = np.quantile(drawn, [0.05, 0.95])
    return Rank(share=float(np.mean(drawn < truth)), inside90=bool(low <= truth <= high))


def uniformity(shares: np.ndarray) -> float:
    """p-value that shares are uniform: the smaller of chi-square over bins and Kolmogorov-Smirnov,
    doubled.
    """
    from scipy.stats import chisquare, kstest

    count = np.histogram(shares, BINS, (0, 1))[0]
    return min(1.0, 2 * min(chisquare(count).pvalue, kstest(shares, "uniform").pvalue))
