"""Test for structure along all families and library effects at once, corrected for multiplicity.

Each family or effect gives a chi-square in the space that the model leaves. The statistic is the
smallest p-value of all. Its threshold is from the null distribution of that minimum, so the
false-alarm rate does not grow with the number of candidates. The distribution is simulated once per
search, for all tests of the search.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from nearlift.declare import FloatArray

#: Draws of the null, which give a rate of 5 % to a relative 6 % (a binomial count of 300), and the
#: batch size.
DRAWS, AT_ONCE = 6000, 1500
#: Probability below which draws are too few to count: -log10 p of the most significant test has an
#: exponential tail there, as that of a single test.
TAIL = 0.02
#: Floor of p-values, against underflow.
LEAST_P = 1e-300
#: Terms of the continued fraction, enough far out in the tail, where it is used.
TERMS = 40
#: Relative difference below which log p-values are tied but for rounding; the first in order leads.
TIED = 1e-9


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """One family, or one shape of the library effect named in `effect`.

    Columns are of log lift (n, k), or (d, k) in a reduced space with unit noise. `covariate` is the
    one along which they vary, as results name it.
    """

    name: str
    covariate: str
    columns: FloatArray
    effect: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Structure:
    """Outcome of the test.

    `log10_p` holds each hypothesis's own log10 p-value; `p_value` is the smallest one, corrected
    for multiplicity. `threshold` is the log10 p below which a single hypothesis is significant at
    the false-alarm rate.
    """

    names: tuple[str, ...]
    covariates: tuple[str, ...]
    log10_p: FloatArray
    p_value: float
    threshold: float

    @property
    def present(self) -> bool:
        """Whether any hypothesis is significant."""
        return bool(self.log10_p.min() < self.threshold)

    def foremost(self) -> dict[str, tuple[float, str]]:
        """The smallest log10 p-value of each covariate and the family or effect that has it, most
        significant first.
        """
        best: dict[str, tuple[float, str]] = {}
        for name, covariate, value in zip(self.names, self.covariates, self.log10_p, strict=True):
            if covariate not in best or value < best[covariate][0] * (1 + TIED):
                best[covariate] = (float(value), name)
        return dict(sorted(best.items(), key=lambda item: item[1][0]))


def mapped(
    hypotheses: tuple[Hypothesis, ...], change: Callable[[FloatArray], FloatArray]
) -> tuple[Hypothesis, ...]:
    """The hypotheses with `change` applied to all their columns in one call."""
    if not hypotheses:
        return ()
    ends = np.cumsum([h.columns.shape[1] for h in hypotheses])[:-1]
    together = np.split(change(np.hstack([h.columns for h in hypotheses])), ends, axis=1)
    return tuple(replace(h, columns=x) for h, x in zip(hypotheses, together, strict=True))


def bases(
    hypotheses: tuple[Hypothesis, ...], remove: FloatArray
) -> tuple[list[int], FloatArray, FloatArray]:
    """Orthonormal bases of the hypotheses, with `remove` (d, q, orthonormal) projected out.

    Returns
    -------
    which : list of int
        Indices of the hypotheses of which anything is left.
    stacked : (d, sum k)
        Their bases side by side.
    ranks : (len(which),)
    """
    which, blocks, ranks = [], [np.zeros((len(remove), 0))], []
    together = np.hstack([*blocks, *(h.columns for h in hypotheses)])
    before = np.linalg.norm(together, axis=0)
    together = together - remove @ (remove.T @ together)
    after = np.linalg.norm(together, axis=0)
    stop = 0
    for i, h in enumerate(hypotheses):
        start, stop = stop, stop + h.columns.shape[1]
        x = together[:, start:stop]
        if stop - start == 1:
            basis = x[:, after[start:stop] > 1e-4 * max(before[start], 1e-300)] / after[start]
        else:
            # by the Gram matrix, with the longest column scaled to 1
            scale = max(before[start:stop].max(initial=0.0), 1e-300)
            squares, turn = np.linalg.eigh((x / scale).T @ (x / scale))
            kept = squares > 1e-11
            basis = x @ (turn[:, kept] / (scale * np.sqrt(squares[kept])))
        if basis.shape[1]:
            which.append(i)
            blocks.append(basis)
            ranks.append(basis.shape[1])
    return which, np.hstack(blocks), np.array(ranks, dtype=int)


def log10_tail(chi2: FloatArray, ranks: FloatArray) -> FloatArray:
    """Log10 of the survival function of chi-square with `ranks` degrees of freedom."""
    from scipy.special import gammaincc, gammaln

    with np.errstate(divide="ignore"):
        result: FloatArray = np.log10(gammaincc(ranks / 2, chi2 / 2))
    far = ~np.isfinite(result) | (result < -250)
    if far.any():
        # the survival function underflows; its logarithm by Legendre's continued fraction does not
        a, z = np.broadcast_arrays(ranks / 2, np.maximum(chi2, 1.0) / 2)
        fraction = z + 2 * TERMS + 1 - a
        for n in range(TERMS, 0, -1):
            fraction = z + 2 * n - 1 - a - n * (n - a) / fraction
        result = np.where(
            far, (a * np.log(z) - z - np.log(fraction) - gammaln(a)) / np.log(10), result
        )
    return result


def chi2_of_each(scores: FloatArray, stacked: FloatArray, ranks: FloatArray) -> FloatArray:
    """Chi-square of scores (..., d) along each hypothesis, (..., hypotheses); `stacked` (d, k) are
    their orthonormal bases side by side, of these ranks.
    """
    first = np.r_[0, np.cumsum(ranks)[:-1]].astype(int)
    return np.asarray(np.add.reduceat((scores @ stacked) ** 2, first, axis=-1))


@lru_cache(maxsize=512)
def _table(rank: int) -> tuple[FloatArray, FloatArray]:
    """Grid of chi-square and its log10 p-value, fine enough for linear interpolation."""
    # even steps of the square root, in which log p is smooth at both ends
    chi2 = np.linspace(0.0, np.sqrt(rank) + 12.0, 3000) ** 2
    return chi2, log10_tail(chi2, np.array(float(rank)))


def least_log10_p(draws: FloatArray, stacked: FloatArray, ranks: FloatArray) -> FloatArray:
    """Smallest log10 p-value of each draw (m, d), from tables; (m,), 0 without hypotheses."""
    least = np.zeros(len(draws))
    if len(ranks):
        chi2 = chi2_of_each(draws, stacked, ranks)
        for rank in np.unique(ranks):
            # at equal degrees of freedom the largest chi-square is the most significant
            most = chi2[:, ranks == rank].max(axis=1)
            np.minimum(least, np.interp(most, *_table(int(rank))), out=least)
    return least


@dataclass(frozen=True, slots=True)
class Null:
    """Null distribution of the smallest log10 p-value of all tests: its draws, ascending, (m,)."""

    least: FloatArray

    @property
    def tail(self) -> tuple[float, float]:
        """Start of the tail and its mean excess (Hill's estimator), both in log10 p."""
        start = float(np.quantile(self.least, TAIL))
        return start, float(np.mean(start - self.least[: max(int(TAIL * len(self.least)), 1)]))

    def threshold(self, rate: float) -> float:
        """Quantile of the smallest log10 p at a false-alarm rate, extrapolated below `TAIL`."""
        if rate >= TAIL:
            return float(np.quantile(self.least, rate))
        start, excess = self.tail
        return start + excess * float(np.log(max(rate, LEAST_P) / TAIL))

    def p_value(self, log10_p: float) -> float:
        """Probability of a smallest log10 p of this value or less."""
        start, excess = self.tail
        if log10_p < start:
            return float(max(TAIL * np.exp((log10_p - start) / max(excess, LEAST_P)), LEAST_P))
        below = np.searchsorted(self.least, log10_p, side="right")
        return float((1 + below) / (1 + len(self.least)))


def draw(
    hypotheses: tuple[Hypothesis, ...], remove: FloatArray, rng: np.random.Generator, dof: float
) -> Null:
    """Simulated null distribution of the smallest p-value of these hypotheses.

    `remove` (d, q) are orthonormal directions that the model absorbs, `dof` the degrees of freedom
    of the noise estimate, whose scale is drawn, too.
    """
    _, stacked, ranks = bases(hypotheses, remove)
    least = []
    for _ in range(0, DRAWS, AT_ONCE):
        draws = rng.standard_normal((AT_ONCE, len(stacked)), dtype=np.float32).astype(float)
        scale = np.sqrt(dof / rng.chisquare(dof, size=(AT_ONCE, 1)))
        least.append(least_log10_p(draws * scale, stacked, ranks))
    return Null(np.sort(np.concatenate(least)))


def examine(
    scores: FloatArray,
    hypotheses: tuple[Hypothesis, ...],
    remove: FloatArray,
    null: Null,
    rate: float,
) -> Structure:
    """Test all hypotheses at once, at a false-alarm `rate` of all together.

    `scores` (d,) are the data in the reduced space, unit noise, with the orthonormal directions
    `remove` (d, q) that the model absorbs already projected out.
    """
    which, stacked, ranks = bases(hypotheses, remove)
    if not which:
        return Structure(
            names=(), covariates=(), log10_p=np.zeros(1), p_value=1.0, threshold=-np.inf
        )
    log10_p = log10_tail(chi2_of_each(scores, stacked, ranks), ranks)
    return Structure(
        names=tuple(hypotheses[i].name for i in which),
        covariates=tuple(hypotheses[i].covariate for i in which),
        log10_p=log10_p,
        p_value=null.p_value(log10_p.min()),
        threshold=null.threshold(rate),
    )
