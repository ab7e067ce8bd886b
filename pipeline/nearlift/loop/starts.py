"""Starting values of candidates' fits: every combination of shapes, fitted to first order about the
base model.

At size zero effects do not interact. A candidate's first-order columns are therefore those of its
effects, and all candidates share them and their products.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from nearlift.declare import Effect, FloatArray
from nearlift.likelihood.problem import Likelihood
from nearlift.loop.candidate import Candidate

#: Added to the diagonal of a normal matrix of unit diagonal, so that it has an inverse.
RIDGE = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """A vector to first order, (P,), with its penalised chi2, and the vector of the same shapes
    without effects.
    """

    cost: float
    vector: FloatArray
    null: FloatArray


@dataclass(frozen=True, slots=True)
class _Signature:
    """One effect: its entries at each of its `shapes`, (m, entries), whitened columns (m, k, n)."""

    shapes: FloatArray
    columns: FloatArray


class Starts:
    """First-order fits about the coefficients `theta` (p,) of the base model that `base`, a
    candidate without effects, holds; `space` whitens and projects out L_inf.
    """

    def __init__(self, space: Likelihood, base: Candidate, theta: FloatArray) -> None:
        self.space, self.base, self.theta = space, base, theta
        columns = space.project(base.jacobian(theta).T)[None]
        self._signatures: dict[Effect | None, _Signature] = {
            None: _Signature(np.zeros((1, 0)), columns)
        }
        self._products: dict[tuple[Effect | None, Effect | None], FloatArray] = {}

    def _signature(self, effect: Effect) -> _Signature:
        if effect not in self._signatures:
            alone, p = replace(self.base, effects=(effect,)), len(self.theta)
            shapes = np.array([*alone.shapes()])
            shapes[:, :p] = self.theta
            sizes = alone.sizes()
            each = [self.space.project(alone.jacobian(shape).T[sizes]) for shape in shapes]
            self._signatures[effect] = _Signature(shapes[:, p:], np.array(each))
        return self._signatures[effect]

    def _product(self, one: Effect | None, two: Effect | None) -> FloatArray:
        """Products of the columns of two effects, None the base model's, (m, m', k, k')."""
        if (one, two) not in self._products:
            a, b = (self._signatures[e].columns for e in (one, two))
            flat = a.reshape(-1, a.shape[-1]) @ b.reshape(-1, b.shape[-1]).T
            self._products[one, two] = flat.reshape(*a.shape[:2], *b.shape[:2]).swapaxes(1, 2)
        return self._products[one, two]

    def ranked(self, candidate: Candidate, log_lift: FloatArray) -> list[Start]:
        """First-order fits of a candidate to log lift (n,), one for each combination of shapes, the
        best first.
        """
        each = [self._signatures[None], *map(self._signature, candidate.effects)]
        effects = [None, *candidate.effects]
        shape = np.array([*product(*(range(len(s.shapes)) for s in each))])
        ends = np.cumsum([0, *(s.columns.shape[1] for s in each)])
        places = [slice(a, b) for a, b in pairwise(ends)]
        residual = self.space.project(log_lift - self.base.log_ratio(self.theta))
        normal, along = np.empty((len(shape), ends[-1], ends[-1])), np.empty((len(shape), ends[-1]))
        for i, mine in enumerate(places):
            along[:, mine] = (each[i].columns @ residual)[shape[:, i]]
            for j, theirs in enumerate(places[: i + 1]):
                block = self._product(effects[i], effects[j])[shape[:, i], shape[:, j]]
                normal[:, mine, theirs] = block
                normal[:, theirs, mine] = block.swapaxes(1, 2)
        p, sizes = len(self.theta), candidate.sizes()
        null = np.tile(candidate.null, (len(shape), 1))
        null[:, :p] = self.theta
        for i, effect in enumerate(candidate.effects, 1):
            null[:, candidate.entries_of(effect.name)] = each[i].shapes[shape[:, i]]
        mean, sd = candidate.prior
        active = np.r_[np.arange(p), sizes]
        weight2 = 1 / sd[active] ** 2
        diagonal = np.arange(len(active))
        chi2_of = normal.copy()
        normal[:, diagonal, diagonal] += weight2
        length = np.sqrt(normal[:, diagonal, diagonal])
        length = np.where(length > 0, length, 1.0)
        scaled = normal / (length[:, :, None] * length[:, None, :])
        scaled[:, diagonal, diagonal] += RIDGE
        pull = along + weight2 * (mean - null)[:, active]
        moved = np.linalg.solve(scaled, (pull / length)[:, :, None])[:, :, 0] / length
        vector = null.copy()
        vector[:, active] += moved
        cost = (
            residual @ residual
            + np.einsum("ci,cij,cj->c", moved, chi2_of, moved)
            - 2 * np.sum(moved * along, axis=1)
            + np.sum(weight2 * (vector - mean)[:, active] ** 2, axis=1)
        )
        order = np.argsort(np.nan_to_num(cost, nan=np.inf), kind="stable")
        return [Start(cost=float(cost[c]), vector=vector[c], null=null[c]) for c in order]
