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

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.candidate_fit import Fitted
from nearlift.results import IntArray

#: An explanation must beat "no effect" by this in log evidence, or chance would be given a name.
CREDIT = 2.0
#: 2 ln(Bayes factor) from which one explanation is plainly likelier than another.
PLAIN_2LNB = 9.0


def mean_evidence(exact: FloatArray | float, discrepant: FloatArray | float) -> FloatArray:
    """Log of the mean evidence, exact and discrepant, given as logarithms.

    It is nan for a fit that has no value at some trial.
    """
    with np.errstate(invalid="ignore"):
        return np.asarray(np.logaddexp(exact, discrepant) - np.log(2.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplanationEvidence:
    """Log evidence of an explanation, in natural logarithms.

    `exact` is with an exact form, `discrepant` with a discrepant one. Both use unit information, so
    that the width of a declared prior does not matter. `unnamed` is the evidence of the null: the
    base model, with a random-walk gain if that is likelier. Where effects have several forms, these
    are of the best one, and `other_forms` is the mean over all forms relative to it.

    A log score on visits left out may take the place of all: it knows of no prior and no form.
    """

    exact: float
    discrepant: float
    unnamed: float = 0.0
    other_forms: float = 0.0

    @property
    def log(self) -> float:
        """Log of the mean evidence, exact and discrepant, over all forms."""
        return float(mean_evidence(self.exact, self.discrepant)) + self.other_forms

    @property
    def over_none(self) -> float:
        """Log Bayes factor over the null."""
        return self.log - self.unnamed

    @property
    def form_share(self) -> float:
        """Probability that the form is discrepant rather than exact."""
        return float(np.exp(self.discrepant - np.logaddexp(self.exact, self.discrepant)))


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

    @property
    def log_likelihood(self) -> FloatArray:
        """Up to a constant of the trials, (m,)."""
        return np.asarray(-0.5 * (np.sum(self.scores**2, axis=0) + self.deform.log_det))


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
    def coefficients(self) -> IntArray:
        """Entries of the base model, the first ones."""
        return self.fitted.candidate.entries_of("")

    @cached_property
    def entries(self) -> IntArray:
        """Entries of the effects."""
        return np.arange(len(self.coefficients), len(self.fitted.vector))

    @cached_property
    def held(self) -> NDArray[np.bool_]:
        """Mask of the entries at a bound, (P,): they cannot move to both sides."""
        low, high = self.fitted.candidate.bounds
        return (self.fitted.vector <= low) | (self.fitted.vector >= high)

    @cached_property
    def bic_charged(self) -> IntArray:
        """Parameters charged ln(n) / 2: prior wider than unit information, or estimate at a bound.

        Parameters that differ by session and the distance datum are not among them. All others are
        integrated over their priors.
        """
        candidate, deform = self.fitted.candidate, RandomEffectsWhitener(self.form_discrepancy)
        absorbed = orthonormal(deform(self.jacobian[:, self.coefficients]))
        left = deform(self.jacobian[:, self.entries])
        left = left - absorbed @ (absorbed.T @ left)
        information = np.sum(left**2, axis=0) * candidate.prior[1][self.entries] ** 2
        asked = (information > candidate.data.n) | self.held[self.entries]
        integrated = candidate.by_session | candidate.at_datum
        return np.asarray(self.entries[asked & ~integrated[self.entries]])

    def integrated(self, fixed: IntArray) -> Integrated:
        """The scores with coefficients and effects' entries `fixed` projected out.

        All other entries that are not held are integrated over.
        """
        mean, sd = self.fitted.candidate.prior
        free = self.entries[~self.held[self.entries]]
        random = np.setdiff1d(free, fixed)
        columns = self.jacobian[:, random]
        deform = RandomEffectsWhitener(np.hstack([columns * sd[random], self.form_discrepancy]))
        projected = np.r_[self.coefficients, np.intersect1d(free, fixed)]
        removed = orthonormal(deform(self.jacobian[:, projected]))
        shift = columns @ (self.fitted.vector - mean)[random]
        left = deform(self.scores + shift[:, None])
        return Integrated(
            scores=left - removed @ (removed.T @ left), removed=removed, deform=deform
        )

    @cached_property
    def left(self) -> Integrated:
        """Scores with all but the coefficients integrated over."""
        return self.integrated(np.arange(0))

    @property
    def without_each(self) -> FloatArray:
        """`left`'s scores without each trial, to first order, (d, n)."""
        each = self.left.deform(np.hstack(self.basis).T * self.fitted.residual)
        return np.asarray(self.left.scores - each)

    @cached_property
    def left_by_unit_information(self) -> Integrated:
        """Scores with coefficients and `bic_charged` parameters projected out.

        All others are integrated over; parameters that differ by session are one population.
        """
        return self.integrated(self.bic_charged)

    @property
    def log(self) -> FloatArray:
        """Log evidence by unit information, (m,), without the penalty for a random-walk gain."""
        candidate, charged = self.fitted.candidate, self.bic_charged
        mean, sd = candidate.prior
        penalty = float(np.sum(((self.fitted.vector - mean)[charged] / sd[charged]) ** 2))
        unknowns = len(charged) + bool(candidate.by_session[self.entries].any())
        price = penalty + unknowns * float(np.log(candidate.data.n))
        likelihood = self.left_by_unit_information.log_likelihood
        return np.asarray(likelihood - 0.5 * price + self.outside)
