"""Student's t at the degrees of freedom that an uncertainty has: none (no interval at all) to
infinitely many (the normal).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nearlift.declare import FloatArray

#: Answers of which one is true: probability, value and standard uncertainty of each.
Mixture = tuple[tuple[float, float, float], ...]
#: Half of a normal's 90 % interval, in standard deviations.
NORMAL_90 = 1.6448536269514722


def quantile(probability: float, dof: float) -> float:
    """Quantile above the median; infinite where `dof` is 0."""
    from scipy.stats import norm, t

    if dof == 0:
        return float("inf")
    return float(t.ppf(probability, dof) if np.isfinite(dof) else norm.ppf(probability))


def interval(level: float, readings: Sequence[Mixture], dof: float) -> tuple[float, float]:
    """Union of the intervals of mixtures at a level, 0 to 1.

    A mean over models covers less than it states, since none of several may be exact. Its tails
    are therefore halved.
    """
    ends = [mixture(0.5 * (1 - level) / min(len(m), 2), np.array(m), dof) for m in readings]
    return min(low for low, _ in ends), max(high for _, high in ends)


def mixture(tail: float, members: FloatArray, dof: float) -> tuple[float, float]:
    """Quantiles `tail` and 1 - `tail` of a mixture; `members` (m, 3) as of a `Mixture`."""
    from scipy.optimize import brentq
    from scipy.special import stdtr

    share, value, u = members.T
    share = share / share.sum()
    reach, freedom, scale = quantile(1 - tail, dof), min(dof, 1e12) or 1.0, np.maximum(u, 1e-300)
    half = np.multiply(reach, u, out=np.zeros_like(u), where=u > 0)

    def end(of_each: FloatArray, probability: float) -> float:
        """Root between the ends of the members' own intervals."""

        def excess(x: float) -> float:
            return float(share @ stdtr(freedom, (x - value) / scale)) - probability

        low, high = float(of_each.min()), float(of_each.max())
        if not np.isfinite([low, high]).all():
            return low if probability < 0.5 else high
        if excess(low) >= 0:
            return low
        return high if excess(high) <= 0 else float(brentq(excess, low, high))

    return end(value - half, tail), end(value + half, 1 - tail)


def several(dof: FloatArray) -> float:
    """Degrees of freedom of the denominator of an F test over directions of so many each (m,).

    Fai & Cornelius 1996 (J. Stat. Comput. Simul. 54, 363): the F distribution whose mean is that of
    the sum of squared t.
    """
    m = len(dof)
    if not np.all(dof > 2):
        return float(dof.min(initial=np.inf))
    mean = float(np.where(np.isfinite(dof), 1 / (1 - 2 / dof), 1.0).sum())
    return 2 * mean / (mean - m) if mean > m * (1 + 1e-12) else float("inf")
