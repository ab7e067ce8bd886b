"""Profile likelihoods: each coefficient held at a row of values, all others optimised.

The quadratic approximation behind ``value ± u`` is right where the profile is a parabola. The
profile shows where it is not, and its interval also holds where a curve saturates, at a bound, or
for degenerate coefficients. L_inf is eliminated; the other coefficients are optimised from the
quadratic approximation, all values in one batch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit import solver
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.likelihood import student
from nearlift.likelihood.stations import Stations
from nearlift.results.fit import ProfileIntervals
from nearlift.results.quotation import LEVELS

#: Points of the first grid. Ours: four per standard uncertainty.
FIRST_POINTS = 33
#: The grid is finer, with so many points, within this many standard uncertainties of the optimum.
#: Ours: a profile is most curved there; ten points per standard uncertainty.
NEAR_U, NEAR_POINTS = 1.5, 31
#: First reach in standard uncertainties; widened while the profile stays below the highest
#: threshold, at most so often. Ours: the 95 % threshold from three degrees of freedom; a widening
#: doubles the reach.
FIRST_REACH_U, MAX_WIDENINGS = 4.0, 5
#: Values closer than this, in standard uncertainties, count as one. Ours: chi2 would differ by
#: rounding.
SAME_VALUE_U = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """The profile of one coefficient.

    Attributes
    ----------
    value : (k,)
        Ascending.
    rise : (k,)
        chi2 above its least, all else optimised.
    """

    value: FloatArray
    rise: FloatArray
    ends: ProfileIntervals


def likelihood_profiles(fit: LeastSquaresFit) -> dict[str, Profile]:
    """The profile of every coefficient that the trials determine, by name."""
    sd = np.sqrt(np.diag(fit.covariance))
    known = [i for i, e in enumerate(fit.estimates.values()) if np.isfinite(e.u) and sd[i] > 0]
    stations = Stations.from_problem(fit.problem, fit.theta, sd)
    return {fit.names[i]: _profile(fit, i, sd, stations) for i in known}


def _profile(fit: LeastSquaresFit, i: int, sd: FloatArray, stations: Stations) -> Profile:
    (low, high), dof = fit.model.parameters[i].bounds, float(fit.effective[i])
    centre = float(np.clip(fit.theta[i], low, high))
    grids = [
        np.linspace(
            max(centre - FIRST_REACH_U * sd[i], low),
            min(centre + FIRST_REACH_U * sd[i], high),
            FIRST_POINTS,
        ),
        np.clip(centre + NEAR_U * sd[i] * np.linspace(-1, 1, NEAR_POINTS), low, high),
    ]
    value, chi2 = np.empty(0), np.empty(0)
    for _ in range(1 + MAX_WIDENINGS):
        further = np.concatenate(grids)
        value, chi2 = np.r_[value, further], np.r_[chi2, _along(fit, i, further, sd, stations)]
        order = np.argsort(value, kind="stable")
        # a parabola between values that differ only by rounding would be noise
        order = order[np.diff(value[order], prepend=-np.inf) > SAME_VALUE_U * sd[i]]
        value, chi2 = value[order], chi2[order]
        short, grids = chi2 - chi2.min() < _threshold(95, dof), []
        if short[0] and value[0] > low:
            grids.append(
                np.linspace(max(2 * value[0] - centre, low), value[0], FIRST_POINTS // 2)[:-1]
            )
        if short[-1] and value[-1] < high:
            grids.append(
                np.linspace(value[-1], min(2 * value[-1] - centre, high), FIRST_POINTS // 2)[1:]
            )
        if not grids:
            break
    value, chi2 = value[np.isfinite(chi2)], chi2[np.isfinite(chi2)]
    rise = chi2 - chi2.min()
    return Profile(value=value, rise=rise, ends=_intervals(value, rise, dof))


def _threshold(level: int, dof: float) -> float:
    """Rise of chi2 at the ends of an interval: squared quantile of Student's t."""
    return student.quantile(0.5 + level / 200, dof) ** 2


def _along(
    fit: LeastSquaresFit, i: int, value: FloatArray, sd: FloatArray, stations: Stations
) -> FloatArray:
    """Least chi2 at each value of coefficient i, less a constant."""
    line = fit.covariance[i] / fit.covariance[i, i]
    start = fit.theta + (value - fit.theta[i])[:, None] * line
    start[:, i] = value
    free = np.arange(len(fit.theta)) != i
    scale = np.where(sd > 0, sd, 1.0)
    system = solver.system_at(stations, np.tile(stations.measured[0], (len(value), 1)))
    return solver.minimise(system, start, fit.model.bounds, scale, free).chi2


def _intervals(value: FloatArray, rise: FloatArray, dof: float) -> ProfileIntervals:
    """Intervals between the crossings of each level's threshold by the profile's nearly straight
    root.
    """
    best, root = int(np.argmin(rise)), np.sqrt(np.maximum(rise, 0.0))
    ends: dict[str, float] = {}
    for level in LEVELS:
        wanted = _threshold(level, dof) ** 0.5
        ends[f"lo{level}"] = _crossing(value[best::-1], root[best::-1], wanted)
        ends[f"hi{level}"] = _crossing(value[best:], root[best:], wanted)
    return ProfileIntervals(**ends)


def _crossing(value: FloatArray, root: FloatArray, wanted: float) -> float:
    """First crossing on the way out, by a monotone cubic of its neighbours; nan without one."""
    from scipy.interpolate import PchipInterpolator

    k = int(np.argmax(root >= wanted))
    if not root[k] >= wanted:
        return float("nan")
    if k == 0:
        return float(value[0])
    x, y = root[max(k - 3, 0) : k + 3], value[max(k - 3, 0) : k + 3]
    rising = np.r_[True, np.diff(np.maximum.accumulate(x)) > 0]
    return float(PchipInterpolator(x[rising], y[rising])(wanted))
