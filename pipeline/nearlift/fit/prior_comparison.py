"""A posterior compared with its prior, its bounds and the interval of least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit.prior import TruncatedPrior

#: Ratio of 90 % widths, posterior over prior, above which the data say nothing, and above which the
#: prior still matters.
SAME, SHAPED = 0.8, 0.3
#: Fraction of the bounded range that counts as at a bound, and the least share of draws there to be
#: reported.
EDGE, CROWD = 0.005, 0.02
#: Ratio of 90 % widths, posterior over least squares, outside which a reason is given; and ratio of
#: prior to least squares below which the prior is one.
NARROW, WIDE, CLOSE = 0.7, 1.4, 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PriorComparison:
    """One parameter's posterior compared with its prior: `ratio` of 90 % widths, shares of draws at
    either bound, and remarks.
    """

    prior: str
    prior_lo90: float
    prior_hi90: float
    ratio: float
    at_low: float
    at_high: float
    words: str


def compare_with_prior(prior: TruncatedPrior, draws: FloatArray) -> PriorComparison:
    """Compare draws (n,) of a parameter's posterior with its prior."""
    low, high = prior.parameter.bounds
    before = prior.quantile([0.05, 0.95])
    after = np.quantile(draws, [0.05, 0.95])
    ratio = float(np.ptp(after) / np.ptp(before))
    edge = EDGE * (high - low)
    at_low, at_high = float(np.mean(draws < low + edge)), float(np.mean(draws > high - edge))
    name = prior.parameter.name
    words = []
    if ratio > SAME:
        words.append(
            f"the data say nothing about {name}: its interval is the prior's"
            f" ({prior.parameter.prior}), not a result"
        )
    elif ratio > SHAPED:
        words.append(
            f"the prior still shapes {name}: the data left {100 * ratio:.0f} % of its width"
            f" ({prior.parameter.prior})"
        )
    for share, bound in ((at_low, low), (at_high, high)):
        if share > CROWD:
            words.append(
                f"{100 * share:.0f} % of the posterior of {name} lies against its bound {bound:g}"
            )
    return PriorComparison(
        prior=str(prior.parameter.prior),
        prior_lo90=float(before[0]),
        prior_hi90=float(before[1]),
        ratio=ratio,
        at_low=at_low,
        at_high=at_high,
        words="; ".join(words),
    )


def compare_with_fit(
    prior: TruncatedPrior, draws: FloatArray, lo90: float, hi90: float
) -> tuple[float, str]:
    """Ratio of the posterior's 90 % width to that of least squares, `lo90` to `hi90`, with a reason
    where far from 1; nan where the latter has none.
    """
    wide = hi90 - lo90
    if not (np.isfinite(wide) and wide > 0):
        return float("nan"), ""
    ratio = float(np.ptp(np.quantile(draws, [0.05, 0.95])) / wide)
    if NARROW <= ratio <= WIDE:
        return ratio, ""
    low, high = prior.parameter.bounds
    edge = EDGE * (high - low)
    reasons = [
        f"the bound {b:g} cuts it off"
        for b, out in ((low, lo90 < low + edge), (high, hi90 > high - edge))
        if out and ratio < NARROW
    ]
    if ratio < NARROW and prior.width90 < CLOSE * wide:
        reasons.append("the prior narrows it")
    reasons = reasons or [
        "the curve is not straight over the interval, as least squares takes it for"
    ]
    name = prior.parameter.name
    return (
        ratio,
        (
            f"the 90 % interval of {name} is {ratio:.2g} times as wide as that of least squares,"
            f" probably because {' and '.join(reasons)}; see its profile"
        ),
    )
