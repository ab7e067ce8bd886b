"""Penalised least squares of a candidate: weak priors, bounds, and starts over shape parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from nearlift.declare import Effect, FloatArray
from nearlift.fit import solver
from nearlift.fit.information import JointInformation, joint_information
from nearlift.likelihood.problem import Likelihood
from nearlift.loop.candidate import Candidate
from nearlift.results import IntArray

#: Effects with their flat vector, fitted or assumed: the base model's entries, then their own.
Point = tuple[tuple[Effect, ...], FloatArray]
#: A vector to first order, (P,), and the vector of the same shapes without effects.
Start = tuple[FloatArray, FloatArray]
#: Maximum number of bisections of a start beyond a pole towards the null.
HALVINGS = 8
#: Gain of the objective in one step, below which a search ends; evidences differ by units.
SUFFICIENT_GAIN = 1e-3
#: Added to the diagonal of a normal matrix of unit diagonal, so that it has an inverse.
RIDGE = 1e-12
#: Variance of an undetermined parameter: beyond all bounds, and finite, as differences of variances
#: are taken.
UNDETERMINED = 1e30


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """A candidate at its penalised least-squares optimum: `residual` is whitened with L_inf
    projected out (by `space`), `penalty` the prior's part of the objective.
    """

    candidate: Candidate
    space: Likelihood
    vector: FloatArray
    residual: FloatArray
    penalty: float

    @property
    def jacobian(self) -> FloatArray:
        """Minus d residual / d vector, (n, P); not stored, since a search keeps every candidate."""
        return self.space.project(self.candidate.jacobian(self.vector).T).T

    def information(self, nuisance: FloatArray | None = None) -> JointInformation:
        """Joint information on the vector, with priors; `nuisance` (n, t) are columns of further
        unknowns of unit variance.
        """
        space = self.space
        if nuisance is not None:
            shared = np.hstack([space.covariance.shared, nuisance])
            space = replace(space, covariance=replace(space.covariance, shared=shared))
        return joint_information(
            space, self.candidate.jacobian(self.vector), self.candidate.prior[1]
        )

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the vector, (P, P), the effects' forms exact."""
        return covariance_of(self.information())

    @property
    def at_bound(self) -> bool:
        """Whether an effect's size is at a bound that is not its null."""
        low, high = self.candidate.bounds
        sizes = self.candidate.sizes()
        value, null = self.vector[sizes], self.candidate.null[sizes]
        return bool(np.any(((value <= low[sizes]) | (value >= high[sizes])) & (value != null)))

    @property
    def datum_chi2(self) -> float:
        """Squared zero error of the distance over its stated uncertainty."""
        mean, sd = self.candidate.prior
        return float(np.sum((((self.vector - mean) / sd)[self.candidate.at_datum]) ** 2))

    @property
    def chi2(self) -> float:
        """Sum of squared whitened residuals, and that of the zero error of the distance."""
        return float(np.sum(self.residual**2)) + self.datum_chi2

    @property
    def point(self) -> Point:
        """Its effects and its vector."""
        return self.candidate.effects, self.vector

    @property
    def cost(self) -> float:
        """Objective that the fit minimises."""
        return float(np.sum(self.residual**2)) + self.penalty


def covariance_of(known: JointInformation) -> FloatArray:
    """Covariance of the parameters, (P, P); an undetermined one has variance `UNDETERMINED`."""
    unknown: FloatArray = np.where(known.determined, 0.0, UNDETERMINED)
    return known.parameter_covariance + np.diag(unknown)


def minima(
    candidate: Candidate,
    log_lift: FloatArray,
    starts: FloatArray,
    project: Callable[[FloatArray, IntArray], FloatArray],
    gain: float = 0.0,
) -> FloatArray:
    """Vectors (m, P) of penalised least squares of log lift (n,) from `starts` (m, P).

    `project` whitens its first argument (k, c, n) with L_inf projected out; the second has the k
    indices of the starts. A search ends where a step gains less than `gain`.
    """

    def residuals(vectors: FloatArray, rows: IntArray) -> FloatArray:
        return project((log_lift - candidate.log_ratio(vectors))[:, None], rows)[:, 0]

    def derivatives(vectors: FloatArray, rows: IntArray) -> FloatArray:
        return -project(candidate.jacobian(vectors).swapaxes(1, 2), rows)

    system = solver.System(residuals, derivatives).penalised(*candidate.prior)
    return solver.minimise(system, starts, candidate.bounds, enough=gain).theta


def fit(candidate: Candidate, space: Likelihood, log_lift: FloatArray, start: FloatArray) -> Fitted:
    """Penalised least squares from `start` (P,); `space` whitens and projects out L_inf."""
    return fits(candidate, space, log_lift, start)[0]


def fits(
    candidate: Candidate, space: Likelihood, log_lift: FloatArray, *starts: FloatArray
) -> list[Fitted]:
    """Penalised least squares from each of `starts` (P,), the best first."""
    mean, sd = candidate.prior
    vectors = np.clip(starts, *candidate.bounds)
    if candidate.size:
        vectors = minima(
            candidate, log_lift, vectors, lambda x, _: space.project(x), SUFFICIENT_GAIN
        )
    fitted = [
        Fitted(
            candidate=candidate,
            space=space,
            vector=vector,
            residual=residual,
            penalty=float(np.sum(((vector - mean) / sd) ** 2)),
        )
        for vector, residual in zip(
            vectors, space.project(log_lift - candidate.log_ratio(vectors)), strict=True
        )
    ]
    return sorted(fitted, key=lambda f: np.nan_to_num(f.cost, nan=np.inf))


def search(candidate: Candidate, starts: Starts, log_lift: FloatArray) -> Fitted:
    """Best fit over the shapes' starting values."""
    return optima(candidate, starts, log_lift)[0]


def optima(candidate: Candidate, starts: Starts, log_lift: FloatArray) -> list[Fitted]:
    """Fits from the two best `starts`, the best first.

    A start beyond a pole of the model, where some trial has no predicted value, is bisected towards
    the null. If that does not help, the result's chi2 is nan.
    """
    vectors = []
    for vector, null in starts.ranked(candidate, log_lift)[:2]:
        for _ in range(HALVINGS):
            if np.isfinite(candidate.log_ratio(np.clip(vector, *candidate.bounds))).all():
                break
            vector = (vector + null) / 2
        vectors.append(vector)
    return fits(candidate, starts.space, log_lift, *vectors)


class Starts:
    """First-order fits about the coefficients `theta` (p,) of the base model that `base`, a
    candidate without effects, holds; `space` whitens and projects out L_inf.

    At size zero effects do not interact. A candidate's first-order columns are therefore those of
    its effects, and all candidates share them and their products.
    """

    def __init__(self, space: Likelihood, base: Candidate, theta: FloatArray) -> None:
        self.space, self.base, self.theta = space, base, theta
        columns = space.project(base.jacobian(theta).T)[None]
        # by effect: its entries at each shape (m, entries), and whitened columns (m, k, n)
        self._signatures: dict[Effect | None, Start] = {None: (np.zeros((1, 0)), columns)}
        self._products: dict[tuple[Effect | None, Effect | None], FloatArray] = {}

    def _signature(self, effect: Effect) -> Start:
        if effect not in self._signatures:
            alone, p = replace(self.base, effects=(effect,)), len(self.theta)
            shapes = np.array([*alone.shapes()])
            shapes[:, :p] = self.theta
            sizes = alone.sizes()
            each = [self.space.project(alone.jacobian(shape).T[sizes]) for shape in shapes]
            self._signatures[effect] = shapes[:, p:], np.array(each)
        return self._signatures[effect]

    def _product(self, one: Effect | None, two: Effect | None) -> FloatArray:
        """Products of the columns of two effects, None the base model's, (m, m', k, k')."""
        if (one, two) not in self._products:
            a, b = (self._signatures[e][1] for e in (one, two))
            flat = a.reshape(-1, a.shape[-1]) @ b.reshape(-1, b.shape[-1]).T
            self._products[one, two] = flat.reshape(*a.shape[:2], *b.shape[:2]).swapaxes(1, 2)
        return self._products[one, two]

    def ranked(self, candidate: Candidate, log_lift: FloatArray) -> list[Start]:
        """First-order fits of a candidate to log lift (n,), one for each combination of shapes, the
        best first.
        """
        effects = [None, *candidate.effects]
        each = [self._signatures[None], *map(self._signature, candidate.effects)]
        shape = np.array([*product(*(range(len(shapes)) for shapes, _ in each))])
        ends = np.cumsum([0, *(columns.shape[1] for _, columns in each)])
        places = [slice(a, b) for a, b in pairwise(ends)]
        residual = self.space.project(log_lift - self.base.log_ratio(self.theta))
        normal, along = np.empty((len(shape), ends[-1], ends[-1])), np.empty((len(shape), ends[-1]))
        p, null = len(self.theta), np.tile(candidate.null, (len(shape), 1))
        null[:, :p] = self.theta
        for i, (effect, (shapes, columns)) in enumerate(zip(effects, each, strict=True)):
            mine = places[i]
            along[:, mine] = (columns @ residual)[shape[:, i]]
            for j, theirs in enumerate(places[: i + 1]):
                block = self._product(effect, effects[j])[shape[:, i], shape[:, j]]
                normal[:, mine, theirs] = block
                normal[:, theirs, mine] = block.swapaxes(1, 2)
            if effect:
                null[:, candidate.entries_of(effect.name)] = shapes[shape[:, i]]
        active = np.r_[np.arange(p), candidate.sizes()]
        mean, sd = (x[active] for x in candidate.prior)
        weight2, diagonal = 1 / sd**2, np.arange(len(active))
        chi2_of = normal.copy()
        normal[:, diagonal, diagonal] += weight2
        length = np.sqrt(normal[:, diagonal, diagonal])
        length = np.where(length > 0, length, 1.0)
        scaled = normal / (length[:, :, None] * length[:, None, :])
        scaled[:, diagonal, diagonal] += RIDGE
        pull = along + weight2 * (mean - null[:, active])
        moved = np.linalg.solve(scaled, (pull / length)[:, :, None])[:, :, 0] / length
        vector = null.copy()
        vector[:, active] += moved
        cost = (
            residual @ residual
            + np.einsum("ci,cij,cj->c", moved, chi2_of, moved)
            - 2 * np.sum(moved * along, axis=1)
            + np.sum(weight2 * (vector[:, active] - mean) ** 2, axis=1)
        )
        order = np.argsort(np.nan_to_num(cost, nan=np.inf), kind="stable")
        return [(vector[c], null[c]) for c in order]
