"""Drift of lift within a trial's record, tested against the scatter between visits.

A drift that is the same in every trial shifts all means alike and is absorbed by L_inf; only the
records show it.
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import Effect
from nearlift.results import Observations
from nearlift.results.answers import WithinTrialPower
from nearlift.results.diagnosis import WithinTrial
from nearlift.results.estimate import Estimate

#: Mean change over a record, a fraction of lift, below which significance has no consequence.
HARMLESS = 5e-4


def heating(data: Observations, library: tuple[Effect, ...], rate: float) -> WithinTrial | None:
    """Student's t test and 90 % interval of the mean relative change of lift over a record.

    None where records are unknown or visits too few.

    Visits, not trials, are the independent units: the trials of one visit follow within a minute.
    """
    from scipy.stats import t

    mean = _over_visits(data)
    if mean is None:
        return None
    value, u, visits = mean
    p_value = float(2 * t.sf(abs(value) / u, visits - 1)) if u > 0 else 0.0
    half = float(t.ppf(0.95, visits - 1)) * u
    significant = p_value < rate and abs(value) > HARMLESS
    names = [e.name for e in library if e.within_trial]
    return WithinTrial(
        change_over_record=Estimate(value=value, lo90=value - half, hi90=value + half),
        p_value=p_value,
        significant=significant,
        candidates=tuple(names) if significant else (),
    )


def power(data: Observations, rate: float, chance: float) -> WithinTrialPower | None:
    """Mean relative change over a record that `heating` detects with power `chance` at level
    `rate`.

    None where records are unknown or visits too few.
    """
    from scipy.optimize import brentq
    from scipy.stats import nct, t

    mean = _over_visits(data)
    if mean is None:
        return None
    _, u, visits = mean
    critical = float(t.ppf(1 - rate / 2, visits - 1))
    limit = u * float(brentq(lambda shift: nct.sf(critical, visits - 1, shift) - chance, 0.0, 20.0))
    return WithinTrialPower(visits=visits, limit=max(limit, HARMLESS))


def _over_visits(data: Observations) -> tuple[float, float, int] | None:
    """Mean relative change over a record and its standard uncertainty, from how many visits; None
    where records are unknown or visits are fewer than five.
    """
    drift = data.covariates.get("drift_hat")
    if drift is None or not np.isfinite(drift).all() or not np.any(drift):
        return None
    _, visit = np.unique(data.visit, return_inverse=True)
    means = np.bincount(visit, drift) / np.bincount(visit)
    visits = len(means)
    if visits < 5:
        return None
    return float(means.mean()), float(means.std(ddof=1) / np.sqrt(visits)), visits
