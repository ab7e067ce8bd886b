"""Tail of importance weights: the shape k of a generalised Pareto distribution.

Below 0.5 the weights have a finite variance; up to 0.7 their averages can be used; beyond, they
cannot be trusted however many there are. Fit: Zhang and Stephens, Technometrics 51 (2009); what to
fit, and the limits: Vehtari, Simpson, Gelman, Yao and Gabry, JMLR 25 (2024).
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray

#: Shape k from which weights are not used.
LIMIT = 0.7


def shape(excess: FloatArray) -> float:
    """Shape k of a generalised Pareto distribution from ascending excesses (n,), not all 0."""
    n = len(excess)
    m = 30 + int(np.sqrt(n))
    quartile = max(excess[int(n / 4 + 0.5) - 1], 1e-12 * excess[-1])
    theta = 1 / excess[-1] + (1 - np.sqrt(m / (np.arange(m) + 0.5))) / (3 * quartile)
    k = np.log1p(-theta[:, None] * excess).mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        profile = n * (np.log(-theta / k) - k - 1)
    profile = np.where(np.isfinite(profile), profile, -np.inf)
    weight = np.exp(profile - profile.max())
    best = float(theta @ weight / weight.sum())
    return float(np.log1p(-best * excess).mean())


def pareto_k(log_weights: FloatArray) -> float:
    """Shape of the upper tail of importance weights, shrunk towards 0.5; 0 without a tail."""
    n = len(log_weights)
    size = int(np.ceil(min(0.2 * n, 3 * np.sqrt(n))))
    weights = np.sort(np.exp(log_weights - np.max(log_weights)))
    excess = weights[-size:] - weights[-size - 1]
    if size < 5 or excess[-1] < 1e-12:
        return 0.0
    return (size * shape(excess) + 5) / (size + 10)


def enough(k: float) -> float:
    """Number of draws that weights with tail k need; inf from k = 1 on."""
    return 10 ** (1 / (1 - max(k, 0.0))) if k < 1 else np.inf
