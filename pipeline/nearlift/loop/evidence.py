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

from nearlift.declare import FloatArray
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.candidate_fit import Fitted
from nearlift.results import IntArray

#: An explanation must beat "no effect" by this in log evidence, or chance would be given a name.
CREDIT = 2.0
#: 2 ln(Bayes factor) from which one explanation is plainly likelier than another.
PLAIN_2LNB = 9.0


def mean_evidence(exact: FloatArray | float, discrepant: FloatArray | float) -> FloatArray:
    """Log of the mean evidence of both form models, given as logarithms.

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
    """

    exact: float
    discrepant: float
    unnamed: float
    other_forms: float = 0.0

    @classmethod
    def of_score(cls, score: float) -> ExplanationEvidence:
        """A log score on visits left out, relative to the base model's, in the place of all: it
        knows of no prior and no form.
        """
        return cls(exact=score, discrepant=score, unnamed=0.0)

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
        self.columns = columns
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
        result = np.zeros((len(self.scores), columns.shape[1]))
        result[: len(columns)] = columns
        return result

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
class Linearised:
    """A fit in the coordinates of an orthonormal basis (n, d) of whitened log lift.

    `jacobian` (d, P) are its derivatives there; `form_discrepancy` (d, t) are unit-variance columns
    of the uncertainty of its form.
    """

    fitted: Fitted
    jacobian: FloatArray
    form_discrepancy: FloatArray

    @property
    def coefficients(self) -> IntArray:
        """Entries of the base model, the first ones."""
        return self.fitted.candidate.entries_of("")

    @cached_property
    def entries(self) -> IntArray:
        """Entries of the effects."""
        return np.arange(len(self.coefficients), len(self.fitted.vector))

    @cached_property
    def free(self) -> IntArray:
        """The effects' entries, but for those held at a bound: they cannot move to both sides."""
        low, high = self.fitted.candidate.bounds
        inside = (self.fitted.vector > low) & (self.fitted.vector < high)
        return self.entries[inside[self.entries]]

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
        low, high = candidate.bounds
        held = (self.fitted.vector <= low) | (self.fitted.vector >= high)
        asked = (information > candidate.data.n) | held[self.entries]
        integrated = candidate.by_session | candidate.at_datum
        return np.asarray(self.entries[asked & ~integrated[self.entries]])

    def integrated(self, scores: FloatArray, fixed: IntArray, random: IntArray) -> Integrated:
        """The scores (d, m) with the entries `fixed` projected out and those `random` integrated
        over.
        """
        mean, sd = self.fitted.candidate.prior
        columns = self.jacobian[:, random]
        deform = RandomEffectsWhitener(np.hstack([columns * sd[random], self.form_discrepancy]))
        removed = orthonormal(deform(self.jacobian[:, fixed]))
        shift = columns @ (self.fitted.vector - mean)[random]
        left = deform(scores + shift[:, None])
        return Integrated(
            scores=left - removed @ (removed.T @ left), removed=removed, deform=deform
        )

    def by_priors(self, scores: FloatArray) -> Integrated:
        """The scores with the coefficients projected out and all else integrated over."""
        return self.integrated(scores, self.coefficients, self.free)

    def by_unit_information(self, scores: FloatArray) -> Integrated:
        """The scores with coefficients and `bic_charged` parameters projected out.

        All others are integrated over; parameters that differ by session are one population.
        """
        charged = np.intersect1d(self.free, self.bic_charged)
        rest = np.setdiff1d(self.free, charged)
        return self.integrated(scores, np.r_[self.coefficients, charged], rest)

    def log(self, left: Integrated) -> FloatArray:
        """Log evidence by unit information, (m,), of what `by_unit_information` leaves: it decides
        who belongs.
        """
        candidate, bic_charged = self.fitted.candidate, self.bic_charged
        mean, sd = candidate.prior
        penalty = float(np.sum(((self.fitted.vector - mean)[bic_charged] / sd[bic_charged]) ** 2))
        unknowns = len(bic_charged) + bool(candidate.by_session[self.entries].any())
        price = penalty + unknowns * float(np.log(candidate.data.n))
        return np.asarray(left.log_likelihood - 0.5 * price)


@dataclass(frozen=True, kw_only=True)
class LinearFit:
    """A linearised fit with an exact or discrepant form, and the size of its `random_walk_gain`.

    Its coordinates are those of an orthonormal `basis` (n, c) and of the `rest` (n, d - c).
    """

    here: Linearised
    basis: FloatArray
    rest: FloatArray
    random_walk_gain: float

    @cached_property
    def scores(self) -> FloatArray:
        """Residual of the fit in these coordinates, (d, 1)."""
        residual = self.here.fitted.residual
        return np.concatenate([self.basis.T @ residual, self.rest.T @ residual])[:, None]

    @cached_property
    def left(self) -> Integrated:
        """Residual scores with all but the coefficients integrated over."""
        return self.here.by_priors(self.scores)

    @property
    def without_each(self) -> FloatArray:
        """Residual scores without each trial, to first order, (d, n)."""
        basis = np.hstack([self.basis, self.rest])
        each = self.left.deform(basis.T * self.here.fitted.residual)
        return np.asarray(self.left.scores - each)

    @cached_property
    def left_by_unit_information(self) -> Integrated:
        """Residual scores with `bic_charged` parameters projected out."""
        return self.here.by_unit_information(self.scores)

    @property
    def log(self) -> float:
        """Log evidence by unit information, without the penalty for a random-walk gain."""
        return float(self.here.log(self.left_by_unit_information)[0]) + self.outside

    @property
    def outside(self) -> float:
        """Log likelihood of the part of the residual outside the basis: no unknown changes it."""
        return -0.5 * float(np.sum(self.here.fitted.residual**2) - np.sum(self.scores**2))
