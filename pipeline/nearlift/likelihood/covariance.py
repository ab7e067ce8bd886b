"""Covariance of the trials' log lift, kept as its components, with an inverse square root applied
in O(n).

The first layer is each trial's own variance. The second are components shared with earlier trials
in run order: the height of a visit, its other common errors, slow drift. The third is a few shared
unknowns (a budget's components), each with its column of sensitivities. No n x n matrix is formed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.likelihood import semiseparable
from nearlift.likelihood.subspace import left_singular
from nearlift.results import IntArray

#: A campaign of exact numbers still needs a positive variance of log lift. Ours: one part in a
#: million, below the resolution of any load cell.
LEAST_VARIANCE = 1e-12
#: Most trials of a visit that are whitened as a block. Ours, by timing: with more, the recursion is
#: faster.
MAX_BLOCK = 32


@dataclass(frozen=True, kw_only=True)
class Covariance:
    """``diag(variance) + sum_v (h_v h_v' + common^2 1_v 1_v') + sum_k drift_k^2 M_k + shared
    shared'``, `h_v` and `1_v` of visit v.

    Trials are in run order; those of one visit are taken together.

    Attributes
    ----------
    variance : (n,)
        Each trial's own variance; positive.
    visit : (n,) int
        Which visit a trial belongs to; any labels.
    per_visit : (n,)
        Sensitivity to the visit's shared unknown of unit variance; zeros where there is none.
    shared : (n, m)
        Sensitivities to m further unknowns of unit variance.
    common : float
        Standard deviation of what else the trials of a visit have in common.
    drift : (k,)
        Standard deviations of k drifts.
    age : (n, k)
        When a trial was run, in units of the time over which each drift forgets: ``M_k[i, j] =
        exp(-|age_i - age_j|)``.
    """

    variance: FloatArray
    visit: IntArray
    per_visit: FloatArray
    shared: FloatArray
    common: float = 0.0
    drift: FloatArray = field(default_factory=lambda: np.zeros(0))
    age: FloatArray = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """The trials with each visit's together, visits as they began."""
        _, first, label = np.unique(self.visit, return_index=True, return_inverse=True)
        return np.argsort(first[label], kind="stable")

    @cached_property
    def processes(self) -> tuple[FloatArray, FloatArray]:
        """Amplitude and memory, (n, J) each, in `order`: the height of a visit, what it has in
        common, the drifts.
        """
        order = self.order
        drifts = [np.full(len(order), float(size)) for size in self.drift]
        amplitude = np.stack(
            [self.per_visit[order], np.full(len(order), self.common), *drifts], axis=1
        )
        same = self.visit[order][1:] == self.visit[order][:-1]
        fades = [np.exp(-np.abs(np.diff(self.age[order, k]))) for k in range(len(self.drift))]
        memory = np.vstack(
            [np.zeros((1, amplitude.shape[1])), np.stack([same, same, *fades], axis=1)]
        )
        kept = np.flatnonzero(np.abs(amplitude).max(axis=0, initial=0.0) > 0)
        return np.ascontiguousarray(amplitude[:, kept]), np.ascontiguousarray(memory[:, kept])

    @cached_property
    def _factor(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        amplitude, memory = self.processes
        d, w = semiseparable.factor(
            np.ascontiguousarray(self.variance[self.order]), amplitude, memory
        )
        return d, w, amplitude, memory

    @cached_property
    def _sparse(self) -> Any:
        """Whitener of all but the shared unknowns, trials in `order`, of visits that are small and
        share no drift; else None.

        It equals that of `_factor`, and needs no compiled code.
        """
        from scipy.sparse import csr_array

        blocks = visits_by_size(self.visit[self.order])
        if np.any(self.drift) or blocks[-1].shape[1] > MAX_BLOCK:
            return None
        values, rows, columns = [], [], []
        for block in blocks:
            i, j = np.tril_indices(block.shape[1])
            height, variance = (x[self.order][block] for x in (self.per_visit, self.variance))
            covariance = height[:, :, None] * height[:, None] + self.common**2
            covariance += variance[:, None] * np.eye(block.shape[1])
            try:
                root = np.linalg.inv(np.linalg.cholesky(covariance))
            except np.linalg.LinAlgError:
                # of variances 1e16 apart the recursion makes nan, which solvers refuse
                return None
            values.append(root[:, i, j].ravel())
            rows.append(block[:, i].ravel())
            columns.append(block[:, j].ravel())
        place = np.concatenate(rows), np.concatenate(columns)
        return csr_array((np.concatenate(values), place), shape=2 * self.variance.shape)

    def whiten_own(self, x: FloatArray, transposed: bool = False) -> FloatArray:
        """The whitener of all but the shared unknowns, or its transpose, along the last axis of x
        (..., n); trials in `order` once whitened.
        """
        x = np.broadcast_to(x, np.broadcast_shapes(x.shape, self.variance.shape))
        columns = x.reshape(math.prod(x.shape[:-1]), x.shape[-1]).T
        columns = np.ascontiguousarray(columns if transposed else columns[self.order])
        if self._sparse is not None:
            solved = (self._sparse.T if transposed else self._sparse) @ columns
        else:
            solve = semiseparable.backward if transposed else semiseparable.forward
            solved = solve(*self._factor, columns)
        if transposed:
            placed = np.empty_like(solved)
            placed[self.order] = solved
            solved = placed
        return np.asarray(solved.T.reshape(x.shape), dtype=np.float64)

    def solve_own(self, x: FloatArray) -> FloatArray:
        """Apply the inverse covariance that trials would have were the shared unknowns known, along
        the last axis of x (..., n).
        """
        return self.whiten_own(self.whiten_own(x), transposed=True)

    def precision_blocks(self) -> tuple[tuple[IntArray, FloatArray], ...]:
        """Trials (m, b) and their block (m, b, b) of that inverse for each visit; one pair for each
        size b.
        """
        place = np.empty(len(self.order), dtype=np.int64)
        place[self.order] = np.arange(len(self.order))
        blocks = visits_by_size(self.visit)
        reach = np.zeros(len(self.order), dtype=np.int64)
        for index in blocks:
            reach[place[index]] = np.arange(index.shape[1])[::-1]
        near = semiseparable.near_inverse(*self._factor, reach)
        pairs = []
        for index in blocks:
            size = index.shape[1]
            i, j = np.triu_indices(size)
            block = np.empty((len(index), size, size))
            block[:, i, j] = block[:, j, i] = near[place[index[:, i]], j - i]
            pairs.append((index, block))
        return tuple(pairs)

    @cached_property
    def _shared_part(self) -> tuple[FloatArray, FloatArray]:
        """Orthonormal directions (n, k) of the whitened shared unknowns, and their
        squared lengths.
        """
        whitened = self.whiten_own(self.shared.T).T
        basis, length = left_singular(whitened)
        return basis, length**2

    def whiten(self, x: FloatArray) -> FloatArray:
        """Apply a W with W C W' = 1 along the last axis, shape (..., n)."""
        return self._less_shared(self.whiten_own(x))

    def unwhiten(self, x: FloatArray) -> FloatArray:
        """Apply W' of the same W along the last axis, shape (..., n): after `whiten`, the inverse
        covariance.
        """
        return self.whiten_own(self._less_shared(x), transposed=True)

    def _less_shared(self, x: FloatArray) -> FloatArray:
        if not self.shared.shape[1]:
            return x
        basis, length2 = self._shared_part
        return x - ((x @ basis) * (1 - 1 / np.sqrt(1 + length2))) @ basis.T

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation of each trial, what is shared beyond visits and drifts left
        out, (n,).
        """
        result: FloatArray = np.sqrt(
            self.variance + self.per_visit**2 + self.common**2 + np.sum(self.drift**2)
        )
        return result

    @cached_property
    def log_det(self) -> float:
        """Logarithm of the determinant."""
        conditional = self._factor[0] if self._sparse is None else self._sparse.diagonal() ** -2.0
        total = float(np.log(conditional).sum())
        if self.shared.shape[1]:
            total += float(np.log1p(self._shared_part[1]).sum())
        return total

    def dense(self) -> FloatArray:
        """The (n, n) matrix, for tests and small reports."""
        same = self.visit[:, None] == self.visit
        result = (
            np.diag(self.variance)
            + self.shared @ self.shared.T
            + same * (np.outer(self.per_visit, self.per_visit) + self.common**2)
        )
        for size, age in zip(self.drift, self.age.T, strict=False):
            result += size**2 * np.exp(-np.abs(age[:, None] - age))
        return np.asarray(result, dtype=np.float64)


def visits_by_size(visit: IntArray) -> list[NDArray[np.int64]]:
    """Trials of each visit in run order, visits of one size stacked: arrays (m, b), b ascending."""
    _, label, count = np.unique(visit, return_inverse=True, return_counts=True)
    order = np.argsort(label, kind="stable")
    first = np.r_[0, np.cumsum(count)[:-1]]
    return [order[first[count == size][:, None] + np.arange(size)] for size in np.unique(count)]


def group_sums(x: FloatArray, label: IntArray) -> FloatArray:
    """Sums of x (..., n) over the trials of each group, (..., groups); labels are 0, 1, ... without
    a gap.
    """
    order = np.argsort(label, kind="stable")
    first = np.flatnonzero(np.diff(label[order], prepend=-1))
    result: FloatArray = np.add.reduceat(x[..., order], first, axis=-1)
    return result
