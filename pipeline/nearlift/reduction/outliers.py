"""Outlying trials: lifts that are farther from their repeats and neighbours than noise allows,
before any model.

A trial is compared with the other trials of its (distance, throttle) cell; what remains, with that
of the other trials of its visit. What moves a whole visit (its height, a drift, a gain) cancels. So
does what moves a whole cell (the curve, a rotor that stalls). Hence an undeclared effect is no
outlier. The scale is the median absolute deviation over the campaign. The noise is not assumed to
be normal. Student's t is fitted to the larger part of the contrasts. Its degrees of freedom are
unknown and integrated over. The largest contrasts are only counted, so that an outlier does not
widen the tail that it is judged by.

Sources: Hampel 1974, J. Am. Stat. Assoc. 69, 383 (median and its deviation); Rosner 1983,
Technometrics 25, 165 (several outliers at once).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, stdtr

from nearlift.declare import BoolArray, FloatArray, IntArray
from nearlift.reduction.stretch import SD_PER_MAD, median

#: Chance that a boundary whose noise has tails no heavier than Student's t with six degrees of
#: freedom carries an outlying trial.
FAMILY_WISE = 0.01
#: Fewer trials with repeats or neighbours than this say nothing of how far noise reaches.
LEAST_TRIALS = 20
#: With fewer trials than this a throttle borrows the scale of all.
OWN_SCALE = 8
#: Robust standard deviations beyond which a trial, or a visit as a whole, is odd: no outlier yet,
#: but two such may hide each other in a fit.
ODD_TRIAL, ODD_VISIT = 5.0, 4.0
#: A relative scatter that is rounding.
SMALLEST_SCALE = 1e-9
#: The tail's shape is learnt from contrasts beyond this quantile; the `COUNTED` largest are only
#: counted.
BODY = 0.7
COUNTED = 4
#: 1 / (degrees of freedom) lies between these, with an exponential prior of mean `TAIL_PRIOR`, by
#: simulation (docs/decisions.md#outliers). No campaign shows that its noise is normal as far
#: out as a family-wise rate asks.
TAIL_LIGHTEST, TAIL_HEAVIEST, TAIL_PRIOR = 1 / 6, 1 / 2, 0.04
#: More quantiles than this of a long campaign tell nothing more of its tail.
QUANTILES = 300
#: Neighbours in distance that replace repeats once a curve is taken off.
NEAREST = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Screen:
    """The outliers among n trials, by arrays (n,).

    Those `outlying` are beyond what noise allows at the rate of `FAMILY_WISE` for all together.
    `departure` is log lift less that of repeats and neighbours, nan for a trial that has none.
    `sigmas` is `departure` over its robust scale. `why_not` says why nothing could be screened.
    """

    outlying: BoolArray
    departure: FloatArray
    sigmas: FloatArray
    why_not: str = ""


def screen(
    log_lift: FloatArray,
    z_hat: FloatArray,
    throttle: FloatArray,
    visit: IntArray,
    *,
    curve_removed: bool = False,
) -> Screen:
    """Compare each of n trials of one boundary with its repeats and neighbours.

    A trial that takes part in a median which another outlier spoils is judged again without that
    one.

    Arrays are (n,): natural logarithm of lift, distance over rotor radius (inf in free air),
    throttle, stop of the traverse. With `curve_removed`, `log_lift` is the residual from a fitted
    curve. A trial without repeats or visit mates is then compared with those nearest in distance at
    its throttle.
    """
    n = len(log_lift)
    out, departure, sigmas = np.zeros(n, dtype=bool), np.full(n, np.nan), np.full(n, np.nan)
    cell = _cells(z_hat, throttle)
    while True:
        value = np.where(out, np.nan, log_lift)
        by_cell = value - _median_of_others(value, cell)
        by_throttle = value - _median_of_others(value, throttle)
        # what a distance does to lift is common to its visits: without repeats, only visit mates
        # can take it off; the sharpest comparison is the first
        comparisons = [by - _median_of_others(by, visit) for by in (by_cell, by_throttle)]
        comparisons.append(by_cell)
        if curve_removed:
            comparisons.append(value - _median_of_nearest(value, z_hat, throttle))
        contrast, scaled = _scaled(comparisons, throttle)
        departure[~out], sigmas[~out] = contrast[~out], scaled[~out]
        known = np.isfinite(scaled)
        if known.sum() < LEAST_TRIALS:
            compared = int(np.isfinite(contrast).sum())
            why_not = "most trials repeat exactly, so nothing shows how far noise reaches"
            if compared < LEAST_TRIALS:
                why_not = f"{compared} trials have repeats or neighbours to compare with;"
                why_not += f" at least {LEAST_TRIALS} are needed"
            why_not = "" if out.any() else why_not
            return Screen(outlying=out, departure=departure, sigmas=sigmas, why_not=why_not)
        size = np.abs(np.nan_to_num(scaled))
        beyond = _tail(np.abs(scaled[known]), size) * known.sum() < FAMILY_WISE
        # only the worst among those that enter each other's medians: the rest are looked at again
        # without it
        for group in (cell, visit):
            worst = np.zeros(group.max(initial=0) + 1)
            np.maximum.at(worst, group, size)
            beyond &= size >= worst[group]
        if not beyond.any():
            return Screen(outlying=out, departure=departure, sigmas=sigmas)
        out |= beyond


def odd_visits(
    log_lift: FloatArray, z_hat: FloatArray, throttle: FloatArray, visit: IntArray
) -> IntArray:
    """Labels of the visits whose trials together are more than `ODD_VISIT` robust standard
    deviations off their repeats in other visits.

    No outliers yet: an undeclared drift does as much. Arguments as for `screen`.
    """
    off = log_lift - _median_of_others(log_lift, _cells(z_hat, throttle))
    labels = np.unique(visit[np.isfinite(off)])
    common = np.array([abs(np.nanmedian(off[visit == label])) for label in labels])
    scale = SD_PER_MAD * median(common) if len(common) else 0.0
    return labels[common > max(ODD_VISIT * scale, SMALLEST_SCALE)]


def _cells(z_hat: FloatArray, throttle: FloatArray) -> IntArray:
    """Index of each trial's (distance, throttle) cell."""
    return np.unique(np.stack([throttle, z_hat]), axis=1, return_inverse=True)[1].astype(np.int64)


def _scaled(comparisons: list[FloatArray], throttle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Each trial's sharpest contrast, and the same over its robust scale; nan without.

    A comparison's scale is that of all trials to which it could be applied, or of those at the same
    throttle where that is larger.
    """
    contrast, scaled = (np.full(len(throttle), np.nan) for _ in range(2))
    for comparison in comparisons:
        known = np.isfinite(comparison)
        mine = known & np.isnan(contrast)
        if not mine.any():
            continue
        size = np.abs(comparison)
        scale = np.full(len(throttle), SD_PER_MAD * median(size[known]))
        for level in np.unique(throttle[mine]):
            here = known & (throttle == level)
            if here.sum() >= OWN_SCALE:
                scale[here] = np.maximum(scale[here], SD_PER_MAD * median(size[here]))
        contrast[mine] = comparison[mine]
        if known.sum() >= LEAST_TRIALS and np.all(scale > SMALLEST_SCALE):
            scaled[mine] = (comparison / scale)[mine]
    return contrast, scaled


def _groups(value: FloatArray, group: NDArray[Any], rank_by: FloatArray) -> list[NDArray[np.intp]]:
    """Places of the known values of each group of three or more, rising in `rank_by`."""
    known = np.flatnonzero(np.isfinite(value))
    order = known[np.lexsort((rank_by[known], group[known]))]
    groups = np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
    return [members for members in groups if len(members) > 2]


def _median_of_others(value: FloatArray, group: NDArray[Any]) -> FloatArray:
    """Median of the other known values of each one's group; nan with fewer than two others."""
    result = np.full(len(value), np.nan)
    for members in _groups(value, group, value):
        m = len(members)
        ranked, rank = value[members], np.arange(m)
        # the k-th of the others is the k-th of all, or the next where oneself is before it
        low, high = ((m - 2) // 2, (m - 1) // 2)
        result[members] = (ranked[low + (low >= rank)] + ranked[high + (high >= rank)]) / 2
    return result


def _median_of_nearest(value: FloatArray, z_hat: FloatArray, throttle: FloatArray) -> FloatArray:
    """Median of the `NEAREST` others at one's throttle by distance; nan with fewer than two."""
    result = np.full(len(value), np.nan)
    for members in _groups(value, throttle, z_hat):
        m = len(members)
        width = min(NEAREST, m - 1)
        first = np.clip(np.arange(m) - width // 2, 0, m - 1 - width)
        around = first[:, None] + np.arange(width + 1)
        others = around[around != np.arange(m)[:, None]].reshape(m, width)
        result[members] = np.median(value[members][others], axis=1)
    return result


def _tail(reference: FloatArray, size: FloatArray) -> FloatArray:
    """Chance that noise with the tail of `reference` (absolute values) exceeds each `size`.

    Student's t beyond the `BODY` quantile, over a grid of degrees of freedom and scales weighed by
    likelihood and prior.
    """
    ordered = np.sort(reference)
    n, low = len(ordered), int(BODY * len(ordered))
    body, start, end = ordered[low : n - COUNTED], ordered[low], ordered[n - COUNTED - 1]
    weight = max(len(body) / QUANTILES, 1.0)
    if weight > 1:
        body = np.quantile(body, (np.arange(QUANTILES) + 0.5) / QUANTILES)
    inverse = np.linspace(TAIL_LIGHTEST, TAIL_HEAVIEST, 15)[:, None]
    dof = 1 / inverse
    scale = ordered[n // 2] * SD_PER_MAD * np.exp(np.linspace(-1.5, 1.0, 41))
    log_peak = gammaln((dof + 1) / 2) - gammaln(dof / 2) - np.log(np.pi * dof) / 2
    x = body / scale[:, None]
    inside = np.stack([-(d + 1) / 2 * np.log1p(x**2 / d).sum(axis=1) for d in dof[:, 0]])
    inside += len(body) * (log_peak - np.log(scale) + np.log(2))
    begins, beyond = (np.maximum(2 * stdtr(dof, -at / scale), 1e-300) for at in (start, end))
    # only what lies beyond the start speaks of the tail, given that it does
    log_weight = (
        weight * inside
        + COUNTED * np.log(beyond)
        - (weight * len(body) + COUNTED) * np.log(begins)
        - inverse / TAIL_PRIOR
    )
    chance = np.exp(log_weight - log_weight.max())
    chance /= chance.sum() * begins
    # nothing nearer can be beyond a family-wise limit
    far = size > end
    result = np.ones(len(size))
    result[far] = [
        float((chance * 2 * stdtr(dof, -at / scale)).sum()) * (n - low) / n for at in size[far]
    ]
    return result
