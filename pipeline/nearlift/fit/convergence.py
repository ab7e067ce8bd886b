"""Effective sample size and R-hat of chains, rank-normalised and split as in Vehtari et al.,
Bayesian Analysis 16 (2021).

Both assume independent chains. Walkers of an ensemble are dependent, since each proposes from the
positions of the others. `worth` therefore also uses the autocorrelation of the ensemble's mean,
which determines the true error of an average.
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray


def _normal_scores(chains: FloatArray) -> FloatArray:
    """Normal scores of the halves of chains (m, n), by ranks."""
    from scipy.special import ndtri

    half = chains.shape[1] // 2
    halves = np.concatenate([chains[:, :half], chains[:, -half:]])
    # average ranks of ties; scipy.stats would take half a second to import
    _, index, count = np.unique(halves, return_inverse=True, return_counts=True)
    rank = (np.cumsum(count) - 0.5 * (count - 1))[index].reshape(halves.shape)
    return np.asarray(ndtri((rank - 0.375) / (halves.size + 0.25)), dtype=np.float64)


def r_hat(chains: FloatArray) -> float:
    """Larger of the R-hats of location and of spread, chains (m, n); 1 for a constant parameter."""
    if np.ptp(chains) == 0:
        return 1.0
    folded = np.abs(chains - np.median(chains))
    return max(_r_hat(_normal_scores(x)) for x in (chains, folded))


def _r_hat(z: FloatArray) -> float:
    n = z.shape[1]
    within = z.var(axis=1, ddof=1).mean()
    between = z.mean(axis=1).var(ddof=1)
    return float(np.sqrt((n - 1) / n + between / within)) if within > 0 else 1.0


def ess(chains: FloatArray) -> float:
    """Bulk effective sample size of chains (m, n); their size for a constant or under 8 steps."""
    if np.ptp(chains) == 0 or chains.shape[1] < 8:
        return float(chains.size)
    return _ess(_normal_scores(chains))


def worth(chains: FloatArray) -> float:
    """Effective sample size of an ensemble's steps (m, n): the lesser of `ess` and that implied by
    the variance of the ensemble's mean.
    """
    if np.ptp(chains) == 0 or chains.shape[1] < 8:
        return float(chains.size)
    mean = chains.mean(axis=0, keepdims=True)
    wander = float(mean.var(ddof=1)) / _ess(mean)
    return min(ess(chains), float(chains.var()) / wander) if wander > 0 else ess(chains)


def tail(chains: FloatArray) -> float:
    """Tail effective sample size: the lesser `worth` of lying below the 5 % and 95 % quantiles."""
    return min(worth((chains <= q).astype(float)) for q in np.quantile(chains, [0.05, 0.95]))


def _ess(z: FloatArray) -> float:
    m, n = z.shape
    deviation = z - z.mean(axis=1, keepdims=True)
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(deviation, size, axis=1)
    covariance = np.fft.irfft(spectrum * spectrum.conj(), size, axis=1)[:, :n].mean(axis=0) / n
    within = covariance[0] * n / (n - 1)
    total = covariance[0] + (z.mean(axis=1).var(ddof=1) if m > 1 else 0.0)
    rho = 1 - (within - covariance * n / (n - 1)) / total
    rho[0] = 1.0
    # in theory sums of adjacent pairs are positive and decrease (Geyer): truncate and make monotone
    pairs = rho[: n - n % 2].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs < 0)
    last = int(negative[0]) if len(negative) else len(pairs)
    pairs = np.minimum.accumulate(pairs[:last])
    # of the first truncated pair the even lag is kept
    tail = max(float(rho[2 * last]), 0.0) if 2 * last < n else 0.0
    tau = max(-1 + 2 * float(pairs.sum()) + tail, 1 / np.log10(m * n))
    return float(m * n / tau)
