"""The covariance of the trials' log lift, held as what it is made of, and an inverse square root of it applied in O(n).

Layers: a variance of each trial's own; what the trials of one visit of the traverse share (its height; noise that neighbours in
time have in common); and a few shared unknowns (a budget's components), each with its column of sensitivities. Visits are short,
so their part is a stack of small matrices; nothing n x n is ever formed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.results import IntArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: A campaign of exact numbers still needs a positive variance of log lift.
LEAST_VARIANCE = 1e-12


@dataclass(frozen=True, kw_only=True)
class Covariance:
    """``diag(variance) + sum_v (h_v h_v' + serial^2 exp(-|i - j| / serial_length)) + shared shared'``, `h_v` of visit v.

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
    serial, serial_length : float
        Standard deviation of noise common to neighbours within a visit, and the number of trials over which it fades.
    """

    variance: FloatArray
    visit: IntArray
    per_visit: FloatArray
    shared: FloatArray
    serial: float = 0.0
    serial_length: float = 1.0

    @cached_property
    def _blocks(self) -> tuple[tuple[IntArray, FloatArray], ...]:
        """For each size b of visit: trials (m, b) and the lower-triangular whitener of each visit (m, b, b)."""
        found = []
        for index in visits_by_size(self.visit):
            block = visit_blocks(index, self.variance, self.per_visit, self.serial, self.serial_length)
            found.append((index, np.linalg.inv(np.linalg.cholesky(block))))
        return tuple(found)

    def precision_blocks(self) -> tuple[tuple[IntArray, FloatArray], ...]:
        """Trials (m, b) and inverse covariance (m, b, b) of each visit, the shared unknowns left out; one pair for each size b."""
        return tuple((index, whitener.swapaxes(-1, -2) @ whitener) for index, whitener in self._blocks)

    @cached_property
    def _whitener(self) -> csr_array:
        """The visits' whiteners side by side along the diagonal, (n, n), lower triangular where trials stand in run order."""
        from scipy.sparse import csr_array

        rows, columns, values = [], [], []
        for index, whitener in self._blocks:
            i, j = np.tril_indices(index.shape[1])
            rows.append(index[:, i].ravel())
            columns.append(index[:, j].ravel())
            values.append(whitener[:, i, j].ravel())
        n = len(self.variance)
        return csr_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(n, n))

    def _whiten_visits(self, x: FloatArray, transposed: bool = False) -> FloatArray:
        whitener = self._whitener.T if transposed else self._whitener
        x = np.broadcast_to(x, np.broadcast_shapes(x.shape, self.variance.shape))
        result: FloatArray = (whitener @ x.reshape(-1, x.shape[-1]).T).T.reshape(x.shape)
        return result

    @cached_property
    def _shared_part(self) -> tuple[FloatArray, FloatArray]:
        """Orthonormal directions (n, k) of the whitened shared unknowns, and their squared lengths."""
        basis, length, _ = np.linalg.svd(self._whiten_visits(self.shared.T).T, full_matrices=False)
        return basis, length**2

    def shared_precision(self) -> FloatArray:
        """Rows r (k, n) by which the shared unknowns lessen the precision: C^-1 is `precision_blocks` less r' r."""
        if not self.shared.shape[1]:
            return np.zeros((0, len(self.variance)))
        basis, length2 = self._shared_part
        return self._whiten_visits((basis * np.sqrt(length2 / (1 + length2))).T, transposed=True)

    def whiten(self, x: FloatArray) -> FloatArray:
        """Apply a W with W C W' = 1 along the last axis, shape (..., n)."""
        x = self._whiten_visits(x)
        if self.shared.shape[1]:
            basis, length2 = self._shared_part
            x = x - ((x @ basis) * (1 - 1 / np.sqrt(1 + length2))) @ basis.T
        return x

    def unwhiten(self, x: FloatArray) -> FloatArray:
        """Apply W' of the same W along the last axis, shape (..., n): after `whiten`, the inverse covariance."""
        if self.shared.shape[1]:
            basis, length2 = self._shared_part
            x = x - ((x @ basis) * (1 - 1 / np.sqrt(1 + length2))) @ basis.T
        return self._whiten_visits(x, transposed=True)

    @cached_property
    def log_det(self) -> float:
        """Logarithm of the determinant."""
        total = -2.0 * sum(float(np.log(np.diagonal(whitener, axis1=1, axis2=2)).sum()) for _, whitener in self._blocks)
        if self.shared.shape[1]:
            total += float(np.log1p(self._shared_part[1]).sum())
        return total

    def dense(self) -> FloatArray:
        """The (n, n) matrix, for tests and small reports."""
        result = self.shared @ self.shared.T
        for index in visits_by_size(self.visit):
            blocks = visit_blocks(index, self.variance, self.per_visit, self.serial, self.serial_length)
            for trials, block in zip(index, blocks, strict=True):
                result[np.ix_(trials, trials)] += block
        return result


def visits_by_size(visit: IntArray) -> list[NDArray[np.int64]]:
    """Trials of each visit in run order, visits of one size stacked: arrays (m, b), b ascending."""
    _, label, count = np.unique(visit, return_inverse=True, return_counts=True)
    order = np.argsort(label, kind="stable")
    first = np.r_[0, np.cumsum(count)[:-1]]
    return [order[first[count == size][:, None] + np.arange(size)] for size in np.unique(count)]


def group_sums(x: FloatArray, label: IntArray) -> FloatArray:
    """Sums of x (..., n) over the trials of each group, (..., groups); labels are 0, 1, ... without a gap."""
    order = np.argsort(label, kind="stable")
    first = np.flatnonzero(np.diff(label[order], prepend=-1))
    result: FloatArray = np.add.reduceat(x[..., order], first, axis=-1)
    return result


def serial_block(size: int, length: float) -> FloatArray:
    """exp(-|i - j| / length), (size, size)."""
    i = np.arange(size)
    result: FloatArray = np.exp(-np.abs(i[:, None] - i) / length)
    return result


def visit_blocks(index: IntArray, variance: FloatArray, per_visit: FloatArray, serial: float, serial_length: float) -> FloatArray:
    """The covariance within each visit of `index` (m, b): (m, b, b)."""
    size = index.shape[1]
    h = per_visit[index]
    result: FloatArray = variance[index][:, :, None] * np.eye(size) + h[:, :, None] * h[:, None, :]
    return result + serial**2 * serial_block(size, serial_length) if serial else result
