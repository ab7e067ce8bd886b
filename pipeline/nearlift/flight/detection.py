"""Detection of a boundary: its range, and the distance from one reading.

Without a boundary the estimate of L / L_inf scatters about 1 with standard deviation sigma(T). An
alarm is raised when it departs, in the boundary's direction, by more than k_fa sigma, with k_fa the
normal quantile of the false-alarm rate. A boundary that changes lift by D is missed at the given
rate when D = (k_fa + k_miss) sigma. The range is the largest z_hat at which |L / L_inf - 1| is D.

    sigma(T)^2 = short^2 / T + floor^2 + payload^2 + supply^2

Averaging over T reduces only `short`, the standard deviation of a one-second average.

Distance from a reading: on a grid, the prior is multiplied by the likelihood of the measured ratio,
averaged over draws of the model. The hypothesis "beyond" is that of no boundary within the range.
Where a model has the same ratio at two heights, lift cannot distinguish them, and the inversion is
refused.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.flight import Ratio

#: Number of heights of the grid, geometrically spaced, and the lowest z_hat.
GRID, LOWEST = 1200, 1e-3
#: Largest change of L / L_inf between nodes that counts as rounding.
FLAT = 1e-9
#: Prior probability that there is no boundary within the range.
PRIOR_BEYOND = 0.5
#: Distance of a refused reading from all that it could mean, in its standard uncertainties.
TOO_FAR = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Located:
    """Posterior of z_hat, given a boundary within the range; and the posterior probability `beyond`
    that there is none.
    """

    median: float
    lo90: float
    hi90: float
    beyond: float


def grid(low: float, high: float) -> FloatArray:
    """Geometrically spaced heights from `low` to `high`: shape (GRID,)."""
    return np.geomspace(max(low, LOWEST), high, GRID)


def refuse_folds(ratio: Ratio, low: float, high: float, where: str, constant: bool = False) -> None:
    """Refuse a model whose L / L_inf is not monotonic from `low` to `high`; it may be `constant`.

    Raises
    ------
    InputRefused
        It folds (says above which height it does not), has no value somewhere, or is constant.
    """
    z_hat = grid(low, high)
    values = ratio(z_hat)
    if not np.isfinite(values).all():
        bad = float(z_hat[~np.isfinite(values)].max())
        raise InputRefused(
            where, f"the model has no value at z_hat = {bad:.3g}", f"ask above {bad:.3g}"
        )
    change = np.diff(values)
    steep = np.flatnonzero(np.abs(change) > FLAT)
    if not len(steep):
        if constant:
            return
        raise InputRefused(
            where, "the model does not change with distance", "lift says nothing of this boundary"
        )
    against = steep[change[steep] * change[steep[-1]] < 0]
    if len(against):
        turn = float(z_hat[against[-1] + 1])
        raise InputRefused(
            where,
            f"the model folds at z_hat = {turn:.3g}: one lift ratio has two heights",
            f"only heights above {turn:.3g} can be distinguished",
        )


def locate(measured: float, u: float, ratios: Sequence[Ratio], low: float, high: float) -> Located:
    """Posterior of z_hat from a measured L / L_inf with its standard uncertainty `u`, including
    sensor, payload and supply.

    `ratios` are draws of the model, each monotonic (see `refuse_folds`). The prior is uniform in ln
    z_hat from `low` to `high`; that there is no boundary within has the probability `PRIOR_BEYOND`.

    Raises
    ------
    InputRefused
        `u` is not positive, or `measured` is over ten `u` both from 1 and from the model's range.
    """
    if not u > 0:
        raise InputRefused(
            "measured ratio", f"has the uncertainty {u:g}", "give a positive standard uncertainty"
        )
    z_hat = grid(low, high)
    values = np.stack([ratio(z_hat) for ratio in ratios])
    outside = max(float(values.min()) - measured, measured - float(values.max())) / u
    if min(outside, abs(measured - 1.0) / u) > TOO_FAR:
        raise InputRefused(
            "measured ratio",
            f"{measured:.4g} is {outside:.0f} standard uncertainties from everything between"
            f" {values.min():.4g} and {values.max():.4g}",
            "lift has another cause, or its uncertainty is larger than said",
        )
    # both evidences are relative to the larger of the likelihoods at the best height and without a
    # boundary, so that they cannot both underflow
    chi2 = ((measured - values) / u) ** 2
    nearest, alone = float(chi2.min()), ((measured - 1.0) / u) ** 2
    least = min(nearest, alone)
    log_z = np.log(z_hat)
    mass = np.exp(-0.5 * (chi2 - nearest)).mean(axis=0) * np.gradient(log_z)
    within = float(mass.sum() / (log_z[-1] - log_z[0]) * np.exp(-0.5 * (nearest - least)))
    beyond = PRIOR_BEYOND * math.exp(-0.5 * (alone - least))
    lo90, median, hi90 = np.interp((0.05, 0.5, 0.95), np.cumsum(mass) / mass.sum(), z_hat).tolist()
    return Located(
        median=median,
        lo90=lo90,
        hi90=hi90,
        beyond=beyond / ((1 - PRIOR_BEYOND) * within + beyond),
    )


def ratio_of_hover(
    throttle: float,
    weight_N: float,
    u_weight: float,
    levels: Sequence[float],
    lift_inf_N: Sequence[float],
    u_lift: float,
    u_throttle: float = 0.0,
) -> tuple[float, float]:
    """L / L_inf at hover (weight, payload included, over lift far away at that throttle) and its
    standard uncertainty.

    `levels` are the throttles measured, fractions of full, ascending, and `lift_inf_N` lift far
    away at each; a power law holds between them. `u_weight` and `u_lift` (levels, supply) are
    relative; `u_throttle` is weighted by the exponent of the power law there.

    Raises
    ------
    InputRefused
        The throttle is outside those measured.
    """
    if not levels[0] <= throttle <= levels[-1]:
        raise InputRefused(
            "throttle",
            f"{throttle:.3g} is outside {levels[0]:.3g} to {levels[-1]:.3g}, where lift was"
            " measured",
            "measure lift at that throttle too",
        )
    x, y = np.log(levels), np.log(lift_inf_N)
    ratio = weight_N / math.exp(np.interp(math.log(throttle), x, y))
    exponent = 0.0
    if len(levels) > 1:
        i = int(np.clip(np.searchsorted(levels, throttle), 1, len(levels) - 1))
        exponent = float((y[i] - y[i - 1]) / (x[i] - x[i - 1]))
    return ratio, ratio * math.hypot(u_weight, u_lift, exponent * u_throttle / throttle)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """Noise of a relative lift reading: the standard deviation of the average over one second, and
    that which averaging does not reduce.
    """

    short_per_sqrt_Hz: float
    floor: float

    def sigma(self, averaging_s: float, payload: float = 0.0, supply: float = 0.0) -> float:
        """Standard deviation of the estimated L / L_inf; `payload` and `supply` are relative
        standard uncertainties of weight and of lift by the supply.
        """
        short = self.short_per_sqrt_Hz / math.sqrt(averaging_s)
        return math.hypot(short, self.floor, payload, supply)


def change_needed(sigma: float, false_alarm_rate: float, miss_rate: float) -> float:
    """Relative change of lift that is detected at these rates."""
    from scipy.special import ndtri

    return float(sigma * (-ndtri(false_alarm_rate) - ndtri(miss_rate)))


def reach(ratio: Ratio, change: float, low: float, high: float) -> float:
    """Largest z_hat from `low` to `high` at which |L / L_inf - 1| is at least `change`,
    interpolated on the grid; nan where there is none. A result of `high` is a lower bound.
    """
    z_hat = grid(low, high)
    effect = np.abs(ratio(z_hat) - 1.0)
    enough = np.flatnonzero(effect >= change)
    if not len(enough):
        return math.nan
    last = int(enough[-1])
    if last == len(z_hat) - 1:
        return float(z_hat[-1])
    a, b = effect[last], effect[last + 1]
    return float(z_hat[last] + (z_hat[last + 1] - z_hat[last]) * (a - change) / (a - b))


def reaches(
    ratios: Sequence[Ratio], change: float, low: float, high: float
) -> tuple[float, float, float]:
    """Detection range of the first ratio (the best estimate), and its 90 % interval over the
    others; those without a range count as zero.
    """
    best, *others = (reach(ratio, change, low, high) for ratio in ratios)
    lo90, hi90 = np.percentile(np.nan_to_num(others or [best], nan=0.0), [5, 95]).tolist()
    return best, lo90, hi90
