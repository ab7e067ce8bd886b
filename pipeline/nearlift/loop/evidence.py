"""Evidence for an explanation: the marginal likelihood of the trials, linearised about its fit.

In an orthonormal basis of whitened log lift, entries of the fit's vector are either free and
projected out, or integrated over their priors, as columns of prior size in the covariance with the
residual taken at the priors' centres. The uncertainty of an effect's form is integrated over in the
same way. The search asks for one residual, the planning of a campaign for many drawn ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood.subspace import left_singular, orthonormal
from nearlift.loop.candidate_fit import Fitted
from nearlift.results import IntArray

#: An explanation must beat "no effect" by this in log evidence, or chance would be given a name.
CREDIT = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplanationEvidence:
    """How far the trials speak for an explanation, in natural logarithms.

    `log` is by unit information, so that no effect gains or loses by how wide its prior happens to
    be declared: it decides who belongs. `over_none` is how far that exceeds that of what has
    no name: the base model's, or with a wander beside it (`wander`) if that is likelier.
    `plausibility` is by the priors: it ranks those that belong.
    """

    log: float
    over_none: float
    plausibility: float

    @classmethod
    def of_score(cls, score: float) -> ExplanationEvidence:
        """A log score on visits left out, relative to the base model's, in the place of all three:
        it knows of no prior.
        """
        return cls(log=score, over_none=score, plausibility=score)


class Deformation:
    """``(1 + T T')^(-1/2)`` for a few columns T (d, k)."""

    def __init__(self, columns: FloatArray) -> None:
        self.columns = columns
        self.basis, length = left_singular(columns)
        self.shrink = 1 - 1 / np.sqrt(1 + length**2)
        self.log_det = float(np.log1p(length**2).sum())

    def __call__(self, x: FloatArray) -> FloatArray:
        """Applied to columns (d, m)."""
        result: FloatArray = x - (self.basis * self.shrink) @ (self.basis.T @ x)
        return result


@dataclass(frozen=True, slots=True, kw_only=True)
class Integrated:
    """Scores (d, m) with `removed` (d, q, orthonormal) projected out and the rest of the unknowns
    in the covariance, by `deform`; `log_det` that of all that could have been there.
    """

    scores: FloatArray
    removed: FloatArray
    deform: Deformation
    log_det: float

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
        """Entries of the base model."""
        return self.fitted.candidate.entries_of("").astype(np.int64)

    @cached_property
    def entries(self) -> IntArray:
        """Those of the effects."""
        return np.setdiff1d(np.arange(len(self.fitted.vector)), self.coefficients)

    @cached_property
    def free(self) -> IntArray:
        """The effects' entries, but for those held at a bound: they cannot move to both sides."""
        low, high = self.fitted.candidate.bounds
        inside = (self.fitted.vector > low) & (self.fitted.vector < high)
        return self.entries[inside[self.entries]]

    @cached_property
    def single_and_session(self) -> tuple[IntArray, IntArray]:
        """Free entries that all trials share, and those that differ by session."""
        by_session = self.fitted.candidate.by_session[self.free]
        return self.free[~by_session], self.free[by_session]

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
        held = np.setdiff1d(self.entries, self.free)
        columns = self.jacobian[:, held] * self.fitted.candidate.prior[1][held]
        log_det = Deformation(np.hstack([integrated.deform.columns, columns])).log_det
        return replace(integrated, log_det=log_det) if len(held) else integrated

    def by_unit_information(self, scores: FloatArray) -> Integrated:
        """The scores with all projected out but what differs by session, which is one population,
        integrated over.
        """
        single, session = self.single_and_session
        return self.integrated(scores, np.r_[self.coefficients, single], session)

    def log(self, scores: FloatArray) -> FloatArray:
        """Log evidence by unit information, (m,): it decides who belongs."""
        candidate = self.fitted.candidate
        mean, sd = candidate.prior
        by_session = candidate.by_session[self.entries]
        # at a bound, too, an entry was fitted: only so could the trials push it there
        single, session = self.entries[~by_session], self.entries[by_session]
        left = self.by_unit_information(scores)
        penalty = float(np.sum(((self.fitted.vector - mean)[single] / sd[single]) ** 2))
        unknowns = len(single) + (1 if len(session) else 0)
        price = penalty + unknowns * float(np.log(candidate.data.n))
        return np.asarray(left.log_likelihood - 0.5 * price)
