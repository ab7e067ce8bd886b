"""Posterior of z_hat given a lift ratio or a hover throttle, and the detection range.

On a grid, the prior is multiplied by the likelihood of the measured ratio, averaged over draws of
the model. The hypothesis "beyond" is that of no boundary within the range. Where a model has the
same ratio at two heights, lift cannot distinguish them, and the inversion is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.flight import Ratio

#: Nodes of the grid, geometrically spaced.
NODES = 1200
#: Largest change of L / L_inf between nodes that counts as rounding.
FLAT = 1e-9
#: Prior probability that there is no boundary within the range.
BEYOND = 0.5
#: Probabilities below this are stated as a bound: the likelihood's far tails are not known.
NONE = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightInterval:
    """Median and 90 % interval of a height."""

    median: float
    lo90: float
    hi90: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Located(HeightInterval):
    """Posterior of z_hat, given a boundary within the range; and the posterior probability `beyond`
    that there is none.
    """

    beyond: float


def grid(low: float, high: float) -> FloatArray:
    """Geometrically spaced heights from `low` (at least 0.001) to `high`: shape (NODES,)."""
    return np.geomspace(max(low, 1e-3), high, NODES)


def refuse_folds(ratio: Ratio, low: float, high: float, where: str) -> None:
    """Refuse a model whose L / L_inf is not monotonic from `low` to `high`.

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
    z_hat from `low` to `high`; that there is no boundary within has the probability `BEYOND`.

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
    deviation = (measured - values) / u
    outside = max(float(values.min()) - measured, measured - float(values.max())) / u
    if min(outside, abs(measured - 1.0) / u) > 10:
        raise InputRefused(
            "measured ratio",
            f"{measured:.4g} is {outside:.0f} standard uncertainties from everything between"
            f" {values.min():.4g} and {values.max():.4g}",
            "lift has another cause, or its uncertainty is larger than said",
        )
    # integrals over ln z, in which the prior is flat; both evidences are relative to the larger of
    # the likelihoods at the best height and without a boundary, so that they cannot both underflow
    nearest, alone = float((deviation**2).min()), ((measured - 1.0) / u) ** 2
    likelihood = np.exp(-0.5 * (deviation**2 - nearest)).mean(axis=0)
    log_z = np.log(z_hat)
    width = np.gradient(log_z)
    least = min(nearest, alone)
    evidence = float(
        np.sum(likelihood * width) / (log_z[-1] - log_z[0]) * np.exp(-0.5 * (nearest - least))
    )
    none = float(np.exp(-0.5 * (alone - least)))
    total = (1 - BEYOND) * evidence + BEYOND * none
    mass = likelihood * width
    cumulative = np.cumsum(mass) / mass.sum()
    lo90, median, hi90 = (float(np.interp(q, cumulative, z_hat)) for q in (0.05, 0.5, 0.95))
    return Located(median=median, lo90=lo90, hi90=hi90, beyond=BEYOND * none / total)


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
    log_levels, log_lift = np.log(levels), np.log(lift_inf_N)
    far = float(np.exp(np.interp(np.log(throttle), log_levels, log_lift)))
    ratio = weight_N / far
    i = int(np.clip(np.searchsorted(levels, throttle), 1, max(len(levels) - 1, 1)))
    power = 0.0
    if len(levels) > 1:
        power = float((log_lift[i] - log_lift[i - 1]) / (log_levels[i] - log_levels[i - 1]))
    return ratio, ratio * float(
        np.sqrt(u_weight**2 + u_lift**2 + (power * u_throttle / throttle) ** 2)
    )


def reach(ratio: Ratio, change: float, low: float, high: float) -> float:
    """Largest z_hat from `low` to `high` at which |L / L_inf - 1| is at least `change`,
    interpolated on the grid; nan where there is none. A result of `high` is a lower bound.
    """
    z_hat = grid(low, high)
    effect = np.abs(ratio(z_hat) - 1.0)
    enough = np.flatnonzero(effect >= change)
    if not len(enough):
        return float("nan")
    last = int(enough[-1])
    if last == len(z_hat) - 1:
        return float(z_hat[-1])
    a, b = effect[last], effect[last + 1]
    return float(z_hat[last] + (z_hat[last + 1] - z_hat[last]) * (a - change) / (a - b))


def reaches(
    ratios: Sequence[Ratio], change: float, low: float, high: float
) -> tuple[float, float, float]:
    """Detection range of the first ratio (the best estimate), and its 90 % interval over the
    others.

    Ratios without a range count as zero.
    """
    heights = [reach(f, change, low, high) for f in ratios]
    lo90, hi90 = (
        np.percentile(np.nan_to_num(heights[1:], nan=0.0), [5, 95])
        if len(heights) > 1
        else (heights[0], heights[0])
    )
    return heights[0], float(lo90), float(hi90)
