"""Student's t at the degrees of freedom that an uncertainty has: none (no interval at all) to
infinitely many (the normal).
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray

#: Half of a normal's 90 % interval, in standard deviations.
NORMAL_90 = 1.6448536269514722


def quantile(probability: float, dof: float) -> float:
    """Quantile above the median; infinite where `dof` is 0."""
    from scipy.stats import norm, t

    if dof == 0:
        return float("inf")
    return float(t.ppf(probability, dof) if np.isfinite(dof) else norm.ppf(probability))


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
