"""Evidence for an explanation: the marginal likelihood of the trials, linearised about its fit.

In an orthonormal basis of whitened log lift, entries of the fit's vector are either free and
projected out, or integrated over their priors, as columns of prior size in the covariance with the
residual taken at the priors' centres. The uncertainty of an effect's form is integrated over in the
same way. The search asks for one residual, the planning of a campaign for many drawn ones.

A true effect may scale just as its formula is printed, or only about so: an explanation is judged
by both readings, each as likely as the other beforehand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.candidate_fit import Fitted
from nearlift.results import IntArray

#: An explanation must beat "no effect" by this in log evidence, or chance would be given a name.
CREDIT = 2.0


def mean_evidence(as_printed: FloatArray | float, uncertain: FloatArray | float) -> FloatArray:
    """Log of the mean of two readings' evidence, which are given as logarithms; nan of a fit that
    has no value at some trial.
    """
    with np.errstate(invalid="ignore"):
        return np.asarray(np.logaddexp(as_printed, uncertain) - np.log(2.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplanationEvidence:
    """How far the trials speak for an explanation, in natural logarithms.

    `as_printed` and `uncertain` read its form as certain and as uncertain. Both are by unit
    information, so that no effect gains or loses by how vague its prior happens to be declared:
    they decide who belongs. `unnamed` is that of what has no name: the base model's, or with a
    wander beside it (`wander`) if that is likelier. `plausibility` is by the priors, the mean over
    both readings: it ranks those that belong.
    """

    as_printed: float
    uncertain: float
    unnamed: float
    plausibility: float

    @classmethod
    def of_score(cls, score: float) -> ExplanationEvidence:
        """A log score on visits left out, relative to the base model's, in the place of all: it
        knows of no prior and no form.
        """
        return cls(as_printed=score, uncertain=score, unnamed=0.0, plausibility=score)

    @property
    def log(self) -> float:
        """Of the mean over both readings."""
        return float(mean_evidence(self.as_printed, self.uncertain))

    @property
    def over_none(self) -> float:
        """How far that exceeds the evidence of what has no name."""
        return self.log - self.unnamed

    @property
    def form_share(self) -> float:
        """How likely it is that the form is uncertain rather than as printed."""
        return float(np.exp(self.uncertain - np.logaddexp(self.as_printed, self.uncertain)))

    def leads(self, other: ExplanationEvidence) -> float:
        """By how much it exceeds another's by either reading: the smaller lead."""
        return min(self.as_printed - other.as_printed, self.uncertain - other.uncertain)


class Deformation:
    """``(1 + T T')^(-1/2)`` for a few columns T (d, k)."""

    def __init__(self, columns: FloatArray) -> None:
        self.columns = columns
        squares, turn = np.linalg.eigh(columns.T @ columns)
        squares = np.maximum(squares, 0.0)
        root = np.sqrt(1 + squares)
        self.turned, self.shrink = columns @ turn, 1 / (root * (1 + root))
        self.log_det = float(np.log1p(squares).sum())

    def __call__(self, x: FloatArray) -> FloatArray:
        """Applied to columns (d, m)."""
        return np.asarray(x - (self.turned * self.shrink) @ (self.turned.T @ x))


@dataclass(frozen=True, slots=True, kw_only=True)
class Integrated:
    """Scores (d, m) with `removed` (d, q, orthonormal) projected out and the rest of the unknowns
    in the covariance, by `deform`; `log_det` that of all that could have been there.
    """

    scores: FloatArray
    removed: FloatArray
    deform: Deformation
    log_det: float

    def padded(self, columns: FloatArray) -> FloatArray:
        """Columns of the first of these coordinates (d', m), d' <= d, in all of them, (d, m)."""
        result = np.zeros((len(self.scores), columns.shape[1]))
        result[: len(columns)] = columns
        return result

    def beside(self, columns: FloatArray) -> FloatArray:
        """The same, deformed as the scores are."""
        return self.deform(self.padded(columns))

    def left_of(self, columns: FloatArray) -> FloatArray:
        """The same, with what is removed projected out, too."""
        columns = self.beside(columns)
        return np.asarray(columns - self.removed @ (self.removed.T @ columns))

    @property
    def log_likelihood(self) -> FloatArray:
        """Up to a constant of the trials, (m,)."""
        return np.asarray(-0.5 * (np.sum(self.scores**2, axis=0) + self.log_det))


@dataclass(frozen=True, kw_only=True)
class Linearised:
    """A fit in the coordinates of an orthonormal basis (n, d) of whitened log lift.

    `jacobian` (d, P) are its derivatives there, `tube` (d, t) the unit-variance columns of its
    form's uncertainty.
    """

    fitted: Fitted
    jacobian: FloatArray
    tube: FloatArray

    @property
    def coefficients(self) -> IntArray:
        """Entries of the base model, the first ones."""
        return self.fitted.candidate.entries_of("")

    @cached_property
    def entries(self) -> IntArray:
        """Those of the effects."""
        return np.arange(len(self.coefficients), len(self.fitted.vector))

    @cached_property
    def free(self) -> IntArray:
        """The effects' entries, but for those held at a bound: they cannot move to both sides."""
        low, high = self.fitted.candidate.bounds
        inside = (self.fitted.vector > low) & (self.fitted.vector < high)
        return self.entries[inside[self.entries]]

    @cached_property
    def vague(self) -> IntArray:
        """The effects' entries that all trials share whose prior tells less than a single trial
        does: each pays for unit information, and so does what is held at a bound, for only the
        trials could push it there. The rest is integrated over its prior.
        """
        candidate, deform = self.fitted.candidate, Deformation(self.tube)
        absorbed = orthonormal(deform(self.jacobian[:, self.coefficients]))
        left = deform(self.jacobian[:, self.entries])
        left = left - absorbed @ (absorbed.T @ left)
        information = np.sum(left**2, axis=0) * candidate.prior[1][self.entries] ** 2
        low, high = candidate.bounds
        held = (self.fitted.vector <= low) | (self.fitted.vector >= high)
        asked = (information > candidate.data.n) | held[self.entries]
        return np.asarray(self.entries[asked & ~candidate.by_session[self.entries]])

    def integrated(self, scores: FloatArray, fixed: IntArray, random: IntArray) -> Integrated:
        """The scores (d, m) with the entries `fixed` projected out and those `random` integrated
        over.
        """
        mean, sd = self.fitted.candidate.prior
        columns = self.jacobian[:, random]
        deform = Deformation(np.hstack([columns * sd[random], self.tube]))
        removed = orthonormal(deform(self.jacobian[:, fixed]))
        shift = columns @ (self.fitted.vector - mean)[random]
        left = deform(scores + shift[:, None])
        return Integrated(
            scores=left - removed @ (removed.T @ left),
            removed=removed,
            deform=deform,
            log_det=deform.log_det,
        )

    def by_priors(self, scores: FloatArray) -> Integrated:
        """The scores with the coefficients projected out and all else integrated over; its
        likelihood is the evidence that ranks. An entry at a bound moves no further, but was as
        free to be anywhere else.
        """
        integrated = self.integrated(scores, self.coefficients, self.free)
        if len(self.free) == len(self.entries):
            return integrated
        held = np.setdiff1d(self.entries, self.free)
        columns = self.jacobian[:, held] * self.fitted.candidate.prior[1][held]
        log_det = Deformation(np.hstack([integrated.deform.columns, columns])).log_det
        return replace(integrated, log_det=log_det)

    def by_unit_information(self, scores: FloatArray) -> Integrated:
        """The scores with the coefficients and all that is `vague` projected out, and the rest
        integrated over: what differs by session is one population.
        """
        asked = np.zeros(len(self.fitted.vector), dtype=bool)
        asked[self.vague] = True
        vague, rest = self.free[asked[self.free]], self.free[~asked[self.free]]
        return self.integrated(scores, np.r_[self.coefficients, vague], rest)

    def log(self, left: Integrated) -> FloatArray:
        """Log evidence by unit information, (m,), of what `by_unit_information` leaves: it decides
        who belongs.
        """
        candidate, vague = self.fitted.candidate, self.vague
        mean, sd = candidate.prior
        penalty = float(np.sum(((self.fitted.vector - mean)[vague] / sd[vague]) ** 2))
        unknowns = len(vague) + bool(candidate.by_session[self.entries].any())
        price = penalty + unknowns * float(np.log(candidate.data.n))
        return np.asarray(left.log_likelihood - 0.5 * price)


@dataclass(frozen=True, kw_only=True)
class FormReading:
    """A fit, linearised with its form certain or not and a `wander` beside it, in the coordinates
    of an orthonormal `basis` (n, c) and of the `rest` (n, d - c).
    """

    here: Linearised
    basis: FloatArray
    rest: FloatArray
    wander: float

    @cached_property
    def scores(self) -> FloatArray:
        """The fit's residual there, (d, 1)."""
        residual = self.here.fitted.residual
        return np.concatenate([self.basis.T @ residual, self.rest.T @ residual])[:, None]

    @cached_property
    def left(self) -> Integrated:
        """What it leaves with all but the coefficients integrated over."""
        return self.here.by_priors(self.scores)

    @property
    def without_each(self) -> FloatArray:
        """To first order what it leaves without each trial, (d, n)."""
        basis = np.hstack([self.basis, self.rest])
        each = self.left.deform(basis.T * self.here.fitted.residual)
        return np.asarray(self.left.scores - each)

    @cached_property
    def left_by_unit_information(self) -> Integrated:
        """The same with what is vague projected out."""
        return self.here.by_unit_information(self.scores)

    @property
    def log(self) -> float:
        """Log evidence by unit information, a wander not paid for."""
        return float(self.here.log(self.left_by_unit_information)[0]) + self.outside

    @property
    def plausibility(self) -> float:
        """Log evidence by the priors."""
        return float(self.left.log_likelihood[0]) + self.outside

    @property
    def outside(self) -> float:
        """Log likelihood of the part of the residual outside the basis: no unknown changes it."""
        return -0.5 * (self.here.fitted.chi2 - float(np.sum(self.scores**2)))
