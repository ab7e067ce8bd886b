"""Is there structure, and along what? One test for all families and all library effects at once.

Each family gives a chi-square in the space that the model leaves. The statistic is the most significant of them all, and its
threshold comes from the distribution of that same maximum under the null, so the false-alarm rate does not grow with the
number of candidates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from nearlift.declare import FloatArray

DRAWS = 1500
#: Draws are made in so many parts: often the first already shows that a finding is nothing unusual.
CHUNKS = 5
#: Decades beyond the union bound's threshold at which a finding needs no draws.
CLEAR = 1.0
#: Logarithms of p-values nearer than this part of themselves are the same but for rounding: the first in order stands before.
SAME = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Hypothesis:
    """One family or one effect with one shape, as columns (d, k) in a reduced space with unit noise."""

    name: str
    covariate: str
    columns: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Structure:
    """Outcome of the test.

    `log10_p` holds each hypothesis's own log10 p-value; `p_value` the chance that the largest of them all would be as extreme under
    the null; `threshold` the log10 p below which a single one is significant at the false-alarm rate.
    """

    names: tuple[str, ...]
    covariates: tuple[str, ...]
    log10_p: FloatArray
    p_value: float
    threshold: float

    @property
    def present(self) -> bool:
        """Whether anything exceeds the threshold."""
        return bool(self.log10_p.min() < self.threshold)

    def by_covariate(self) -> dict[str, float]:
        """The smallest log10 p-value of each covariate, most significant first."""
        return {covariate: value for covariate, (value, _) in self.foremost().items()}

    def foremost(self) -> dict[str, tuple[float, str]]:
        """The smallest log10 p-value of each covariate and the family or effect that has it, most significant first."""
        best: dict[str, tuple[float, str]] = {}
        for name, covariate, value in zip(self.names, self.covariates, self.log10_p, strict=True):
            if covariate not in best or value < best[covariate][0] * (1 + SAME):
                best[covariate] = (float(value), name)
        return dict(sorted(best.items(), key=lambda item: item[1][0]))


def mapped(hypotheses: tuple[Hypothesis, ...], change: Callable[[FloatArray], FloatArray]) -> tuple[Hypothesis, ...]:
    """Every hypothesis with its columns changed, all in one call."""
    if not hypotheses:
        return ()
    together = change(np.hstack([h.columns for h in hypotheses]))
    ends = np.cumsum([h.columns.shape[1] for h in hypotheses])[:-1]
    return tuple(replace(h, columns=x) for h, x in zip(hypotheses, np.split(together, ends, axis=1), strict=True))


def bases(hypotheses: tuple[Hypothesis, ...], remove: FloatArray) -> tuple[list[int], FloatArray, FloatArray]:
    """Orthonormal columns of every hypothesis after `remove` (d, q, orthonormal) is projected out.

    Returns
    -------
    which : list of int
        Hypotheses that keep any freedom.
    stacked : (d, sum k)
        Their bases side by side.
    ranks : (len(which),)
    """
    if not hypotheses:
        return [], np.zeros((len(remove), 0)), np.zeros(0, dtype=int)
    together = np.hstack([h.columns for h in hypotheses])
    before = np.linalg.norm(together, axis=0)
    together = together - remove @ (remove.T @ together)
    after = np.linalg.norm(together, axis=0)
    which, blocks, ranks = [], [], []
    stop = 0
    for i, h in enumerate(hypotheses):
        start, stop = stop, stop + h.columns.shape[1]
        x = together[:, start:stop]
        if stop - start == 1:
            if after[start] > 1e-4 * max(before[start], 1e-300):
                which.append(i)
                blocks.append(x / after[start])
                ranks.append(1)
            continue
        # by the small matrix of products; scaled, so that no column's size decides the rank
        scale = max(before[start:stop].max(initial=0.0), 1e-300)
        squares, turn = np.linalg.eigh((x / scale).T @ (x / scale))
        kept = squares > 1e-11
        if kept.any():
            which.append(i)
            blocks.append(x @ (turn[:, kept] / (scale * np.sqrt(squares[kept]))))
            ranks.append(int(kept.sum()))
    stacked = np.hstack(blocks) if blocks else np.zeros((len(remove), 0))
    return which, stacked, np.array(ranks, dtype=int)


def log10_p(scores: FloatArray, stacked: FloatArray, ranks: FloatArray) -> FloatArray:
    """Log10 p-value of each hypothesis for score vectors (..., d); (..., number of hypotheses)."""
    return log10_tail(_chi2(scores, stacked, ranks), ranks)


def log10_tail(chi2: FloatArray, ranks: FloatArray) -> FloatArray:
    """Log10 of the chance that a chi-square with `ranks` degrees of freedom exceeds `chi2`."""
    from scipy.special import gammaincc

    with np.errstate(divide="ignore"):
        result: FloatArray = np.log10(gammaincc(ranks / 2, chi2 / 2))
    far = ~np.isfinite(result) | (result < -250)
    if far.any():
        # the survival function underflows; its leading term does not
        result = np.where(far, -chi2 / 2 / np.log(10), result)
    return result


def _chi2(scores: FloatArray, stacked: FloatArray, ranks: FloatArray) -> FloatArray:
    first = np.r_[0, np.cumsum(ranks)[:-1]].astype(int)
    result: FloatArray = np.add.reduceat((scores @ stacked) ** 2, first, axis=-1)
    return result


@lru_cache(maxsize=512)
def _table(rank: int) -> tuple[FloatArray, FloatArray]:
    """Chi-square and its log10 p-value for one number of degrees of freedom, fine enough for straight lines between."""
    # steps of the square root, in which the logarithm is smooth at both ends
    chi2 = np.linspace(0.0, np.sqrt(rank) + 12.0, 3000) ** 2
    return chi2, log10_tail(chi2, np.array(float(rank)))


def _least(draws: FloatArray, stacked: FloatArray, ranks: FloatArray) -> FloatArray:
    """The smallest log10 p-value of each draw (m, d), from tables."""
    chi2 = _chi2(draws, stacked, ranks)
    least = np.zeros(len(draws))
    for rank in np.unique(ranks):
        # of hypotheses with equal freedom the largest chi-square is the most significant
        np.minimum(least, np.interp(chi2[:, ranks == rank].max(axis=1), *_table(int(rank))), out=least)
    return least


def examine(
    scores: FloatArray,
    hypotheses: tuple[Hypothesis, ...],
    remove: FloatArray,
    rng: np.random.Generator,
    rate: float,
    dof: float,
    multiplicity: bool = True,
    exact: bool = True,
) -> Structure:
    """Test all hypotheses at once.

    Parameters
    ----------
    scores : (d,)
        The data in the reduced space, unit noise, `remove` already projected out.
    hypotheses : tuple of Hypothesis
    remove : (d, q)
        Orthonormal directions that the model absorbs.
    rng : Generator
    rate : float
        False-alarm rate of the maximum.
    dof : float
        Degrees of freedom of the noise estimate; its scale is drawn too.
    exact : bool
        Draw the null distribution even where the union bound already decides; the p-value is then exact.
    multiplicity : bool
        False compares each p-value with the rate as if it were alone: wrong, and here to show what that does.
    """
    which, stacked, ranks = bases(hypotheses, remove)
    names = tuple(hypotheses[i].name for i in which)
    covariates = tuple(hypotheses[i].covariate for i in which)
    if not which:
        return Structure(names=(), covariates=(), log10_p=np.zeros(1), p_value=1.0, threshold=-np.inf)
    observed = log10_p(scores, stacked, ranks)
    if not multiplicity:
        return Structure(names=names, covariates=covariates, log10_p=observed, p_value=float(10 ** observed.min()), threshold=float(np.log10(rate)))
    # by the union bound the threshold lies between rate / number and rate: far outside, the draws would decide nothing
    least_threshold = float(np.log10(rate / len(which)))
    if not exact and (observed.min() < least_threshold - CLEAR or observed.min() > np.log10(rate)):
        clear = observed.min() < least_threshold
        return Structure(
            names=names,
            covariates=covariates,
            log10_p=observed,
            p_value=1 / (1 + DRAWS) if clear else 1.0,
            threshold=least_threshold if clear else float(np.log10(rate)),
        )
    least = np.zeros(0)
    # what only decides is drawn in single precision; a threshold that is published has the same digits on every processor
    kind = np.float64 if exact else np.float32
    columns: FloatArray = np.asarray(stacked, dtype=kind)
    for _ in range(CHUNKS):
        draws = rng.standard_normal((DRAWS // CHUNKS, len(scores)), dtype=np.float32).astype(float)
        scale = np.sqrt(dof / rng.chisquare(dof, size=(len(draws), 1)))
        least = np.append(least, _least(np.asarray(draws * scale, dtype=kind), columns, ranks))
        exceeded = int((least <= observed.min()).sum())
        if not exact and exceeded > rate * DRAWS + 1:
            # whatever the other draws show, the finding will not be among the extreme ones
            return Structure(
                names=names, covariates=covariates, log10_p=observed, p_value=(1 + exceeded) / (1 + len(least)), threshold=float(observed.min())
            )
    threshold = float(np.quantile(least, rate))
    p_value = float((1 + exceeded) / (1 + DRAWS))
    return Structure(names=names, covariates=covariates, log10_p=observed, p_value=p_value, threshold=threshold)
