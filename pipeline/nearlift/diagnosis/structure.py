"""Is there structure, and along what? One test for all families and all library effects at once.

Each family gives a chi-square in the space that the model leaves. The statistic is the most significant of them all, and its
threshold comes from the distribution of that same maximum under the null, so the false-alarm rate does not grow with the
number of candidates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray

DRAWS = 1500
#: Decades beyond the union bound's threshold at which a finding needs no draws.
CLEAR = 1.0


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
        best: dict[str, float] = {}
        for covariate, value in zip(self.covariates, self.log10_p, strict=True):
            best[covariate] = min(best.get(covariate, 0.0), float(value))
        return dict(sorted(best.items(), key=lambda item: item[1]))


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
    which, blocks, ranks = [], [], []
    for i, h in enumerate(hypotheses):
        before = np.linalg.norm(h.columns, axis=0)
        x = h.columns - remove @ (remove.T @ h.columns)
        if x.shape[1] == 1:
            length = np.linalg.norm(x)
            if length > 1e-4 * max(before[0], 1e-300):
                which.append(i)
                blocks.append(x / length)
                ranks.append(1)
            continue
        u, s, _ = np.linalg.svd(x, full_matrices=False)
        rank = int((s > 1e-6 * max(before.max(), 1e-300)).sum())
        if rank:
            which.append(i)
            blocks.append(u[:, :rank])
            ranks.append(rank)
    stacked = np.hstack(blocks) if blocks else np.zeros((len(remove), 0))
    return which, stacked, np.array(ranks)


def log10_p(scores: FloatArray, stacked: FloatArray, ranks: FloatArray) -> FloatArray:
    """Log10 p-value of each hypothesis for score vectors (..., d); (..., number of hypotheses)."""
    from scipy.special import gammaincc

    squares = (scores @ stacked) ** 2
    first = np.r_[0, np.cumsum(ranks)[:-1]].astype(int)
    chi2 = np.add.reduceat(squares, first, axis=-1)
    p = gammaincc(ranks / 2, chi2 / 2)
    with np.errstate(divide="ignore"):
        result: FloatArray = np.log10(p)
    far = ~np.isfinite(result) | (result < -250)
    if far.any():
        # the survival function underflows; its leading term does not
        result = np.where(far, -chi2 / 2 / np.log(10), result)
    return result


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
    draws = rng.standard_normal((DRAWS, len(scores)))
    draws *= np.sqrt(dof / rng.chisquare(dof, size=(DRAWS, 1)))
    least = log10_p(draws, stacked, ranks).min(axis=1)
    threshold = float(np.quantile(least, rate))
    p_value = float((1 + (least <= observed.min()).sum()) / (1 + DRAWS))
    return Structure(names=names, covariates=covariates, log10_p=observed, p_value=p_value, threshold=threshold)
