"""Evidence for an explanation: the marginal likelihood of the trials, linearised about its fit.

Entries of the fit's vector are either free and projected out, or integrated over their priors. The
latter are columns of prior size in the covariance, with the residual taken at the priors' centres.
The uncertainty of an effect's form is integrated over in the same way. All is done in an
orthonormal basis of whitened log lift. The search evaluates one residual, the planning of a
campaign many drawn ones.

The form of an effect may be exact or discrepant: an explanation is judged by both, with equal prior
probability.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.candidate_fit import Fitted
from nearlift.loop.random_walk_gain import waves
from nearlift.loop.structure import Structure
from nearlift.results import IntArray

#: An explanation must beat "no effect" by this in log evidence, or chance would be given a name.
CREDIT = 2.0
#: 2 ln(Bayes factor) from which one explanation is plainly likelier than another.
PLAIN_2LNB = 9.0
#: Least share of the variance of a form's uncertainty that is kept: the evidence for a form as
#: printed is against smooth deformations, and knows nothing of others.
LEAST_SHARE = 0.2


def mean_evidence(exact: FloatArray | float, discrepant: FloatArray | float) -> FloatArray:
    """Log of the mean evidence, exact and discrepant, given as logarithms; nan for a fit that has
    no value at some trial.
    """
    with np.errstate(invalid="ignore"):
        return np.asarray(np.logaddexp(exact, discrepant) - np.log(2.0))


class RandomEffectsWhitener:
    """Whiten by unit-variance random effects with design T (d, k), by ``(1 + T T')^(-1/2)``."""

    def __init__(self, columns: FloatArray) -> None:
        squares, turn = np.linalg.eigh(columns.T @ columns)
        squares = np.maximum(squares, 0.0)
        root = np.sqrt(1 + squares)
        self.turned, self.shrink = columns @ turn, 1 / (root * (1 + root))
        self.log_det = float(np.log1p(squares).sum())

    def __call__(self, x: FloatArray) -> FloatArray:
        """Whitened columns (d, m)."""
        return np.asarray(x - (self.turned * self.shrink) @ (self.turned.T @ x))


@dataclass(frozen=True, slots=True, kw_only=True)
class Integrated:
    """Scores (d, m) with `removed` (d, q, orthonormal) projected out and the other unknowns in the
    covariance, by which `deform` whitens.
    """

    scores: FloatArray
    removed: FloatArray
    deform: RandomEffectsWhitener

    def embed(self, columns: FloatArray) -> FloatArray:
        """Columns (d', m) of the first d' <= d coordinates in all coordinates, (d, m)."""
        return np.pad(columns, ((0, len(self.scores) - len(columns)), (0, 0)))

    def whiten(self, columns: FloatArray) -> FloatArray:
        """Embedded columns, whitened like the scores, (d, m)."""
        return self.deform(self.embed(columns))

    def residual(self, columns: FloatArray) -> FloatArray:
        """Whitened columns with `removed` projected out, (d, m)."""
        columns = self.whiten(columns)
        return np.asarray(columns - self.removed @ (self.removed.T @ columns))


@dataclass(frozen=True, kw_only=True)
class LinearFit:
    """A fit, linearised in the coordinates of an orthonormal basis of whitened log lift.

    Attributes
    ----------
    jacobian : (d, P)
        Derivatives of the fit.
    form_discrepancy : (d, t)
        Unit-variance columns of the uncertainty of its form, and of a random-walk gain of the size
        `random_walk_gain`.
    scores : (d, m)
        Residuals, the fit's or drawn ones.
    outside : float
        Log likelihood of the part of the residual outside the basis: no unknown changes it.
    basis : tuple of arrays (n, k)
        The basis, in parts.
    """

    fitted: Fitted
    jacobian: FloatArray
    form_discrepancy: FloatArray
    scores: FloatArray
    outside: float = 0.0
    random_walk_gain: float = 0.0
    basis: tuple[FloatArray, ...] = ()

    @cached_property
    def entries(self) -> tuple[IntArray, IntArray]:
        """Entries of the base model, and those of the effects that are not at a bound."""
        low, high = self.fitted.candidate.bounds
        held = (self.fitted.vector <= low) | (self.fitted.vector >= high)
        base = self.fitted.candidate.entries_of("")
        return base, np.setdiff1d(np.flatnonzero(~held), base)

    @cached_property
    def bic_charged(self) -> IntArray:
        """Parameters charged ln(n) / 2: prior wider than unit information, or estimate at a bound.

        Parameters that differ by session and the distance datum are not among them. All others are
        integrated over their priors.
        """
        candidate, deform = self.fitted.candidate, RandomEffectsWhitener(self.form_discrepancy)
        base, free = self.entries
        absorbed = orthonormal(deform(self.jacobian[:, base]))
        left = deform(self.jacobian)
        left = left - absorbed @ (absorbed.T @ left)
        with np.errstate(invalid="ignore"):
            information = np.sum(left**2, axis=0) * candidate.prior[1] ** 2
        charged = (information > candidate.data.n) | ~np.isin(np.arange(len(information)), free)
        charged &= ~(candidate.by_session | candidate.at_datum)
        return np.setdiff1d(np.flatnonzero(charged), base)

    def integrated(self, charged: IntArray) -> Integrated:
        """The scores with coefficients and `charged` parameters projected out, those at a bound
        fixed, and all others integrated over.
        """
        mean, sd = self.fitted.candidate.prior
        base, free = self.entries
        random = np.setdiff1d(free, charged)
        columns = self.jacobian[:, random]
        deform = RandomEffectsWhitener(np.hstack([columns * sd[random], self.form_discrepancy]))
        removed = orthonormal(deform(self.jacobian[:, np.r_[base, np.intersect1d(free, charged)]]))
        left = deform(self.scores + (columns @ (self.fitted.vector - mean)[random])[:, None])
        return Integrated(
            scores=left - removed @ (removed.T @ left), removed=removed, deform=deform
        )

    @cached_property
    def left(self) -> Integrated:
        """Scores with all but the coefficients integrated over."""
        return self.integrated(np.arange(0))

    @cached_property
    def left_by_unit_information(self) -> Integrated:
        """Scores with coefficients and `bic_charged` parameters projected out; parameters that
        differ by session are one population.
        """
        return self.integrated(self.bic_charged)

    @property
    def log(self) -> FloatArray:
        """Log evidence by unit information, (m,), without the penalty for a random-walk gain."""
        candidate, charged = self.fitted.candidate, self.bic_charged
        mean, sd = candidate.prior
        penalty = float(np.sum(((self.fitted.vector - mean)[charged] / sd[charged]) ** 2))
        unknowns = len(charged) + bool(candidate.by_session.any())
        price = penalty + unknowns * float(np.log(candidate.data.n))
        left = self.left_by_unit_information
        chi2 = np.sum(left.scores**2, axis=0) + left.deform.log_det
        return np.asarray(self.outside - 0.5 * (chi2 + price))


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """A fitted candidate with its evidence, as an explanation of what the base model leaves.

    Its form is uncertain by `form_sd`; `random_walk_gain` is the size of the gain's random walk.
    `left` is the test for structure on its residuals, None if other tests exclude it.

    `gain` is the drop of chi2 by its declared form, with a size for each session where an effect
    restarts. `needed` is whether each of its effects explains, by that, most of the structure that
    is there without it. The form's uncertainty is not used for that, since with a large effect that
    the coefficients absorb it could explain anything.

    Attributes
    ----------
    exact, discrepant : float
        Log evidence by unit information, with an exact form and with a discrepant one. A log score
        on visits left out may take the place of both.
    unnamed : float
        Log evidence of the null: the base model, with a random-walk gain if that is likelier.
    other_forms : float
        Log of the mean evidence over an effect's forms, relative to the best one.
    confirmed : bool or None
        Set where something else decides: visits left out (`few_visits`), or the share of the
        structure (`search.accept_inexact`).
    """

    fitted: Fitted
    form_sd: float
    exact: float
    discrepant: float
    unnamed: float = 0.0
    other_forms: float = 0.0
    random_walk_gain: float = 0.0
    left: Structure | None = None
    gain: float
    needed: bool = True
    confirmed: bool | None = None

    @property
    def log_evidence(self) -> float:
        """Log of the mean evidence, exact and discrepant, over all forms."""
        return float(mean_evidence(self.exact, self.discrepant)) + self.other_forms

    @property
    def over_none(self) -> float:
        """Log Bayes factor over the null."""
        return self.log_evidence - self.unnamed

    @property
    def eligible(self) -> bool:
        """Whether each effect is `needed`, and no parameter at its bound."""
        return self.needed and not self.fitted.at_bound

    @property
    def accepted(self) -> bool:
        """Whether it may be named: eligible, nothing left beyond the threshold, and plainly
        likelier than none; or `confirmed`.
        """
        if not self.eligible or self.confirmed is not None:
            return self.eligible and bool(self.confirmed)
        return self.left is not None and not self.left.present and self.over_none > CREDIT

    @property
    def may_be_named(self) -> bool:
        """Whether it may be named or be a rival, if any explanation is accepted."""
        return self.accepted or (
            self.over_none > 0
            and not self.fitted.at_bound
            and (self.needed or len(self.effects) == 1)
        )

    def without_rivals(self) -> Explanation:
        """Explanation without rivals, so that the trials determine its form as well.

        The variance of the form is the mean over exact and discrepant form, at least `LEAST_SHARE`.
        """
        share = np.exp(self.discrepant - np.logaddexp(self.exact, self.discrepant))
        return replace(self, form_sd=self.form_sd * float(np.sqrt(max(share, LEAST_SHARE))))

    @property
    def nuisances(self) -> dict[str, FloatArray]:
        """Unit-variance columns (n, t) of its form discrepancy and random-walk gain, by name."""
        candidate = self.fitted.candidate
        columns = {
            f"form of {self.name}": candidate.form_discrepancy(self.fitted.vector, self.form_sd)
        }
        if self.random_walk_gain:
            columns["gain that wanders"] = self.random_walk_gain * waves(candidate.data)
        return columns

    @property
    def form_discrepancy(self) -> FloatArray:
        """All nuisance columns, (n, t)."""
        return np.hstack([*self.nuisances.values()])

    @property
    def name(self) -> str:
        """Names of its effects."""
        return self.fitted.candidate.name

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of its effects, a tuple."""
        return tuple(e.name for e in self.fitted.candidate.effects)
