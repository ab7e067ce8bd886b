"""Smooth columns along a covariate, and orthonormal bases of what columns span, in coordinates that
do not depend on rounding.
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray

#: Share of a column's length outside the span of others below which it is in that span: the rest is
#: rounding, and differs by processor.
SPANNED = 1e-6


def cosines(x: FloatArray, count: int, first: int = 1) -> FloatArray:
    """Smooth shapes along the ranks of `x`: cos(pi j u), j = first .. first + count - 1, u in [0,
    1]; (n, count).
    """
    _, rank = np.unique(x, return_inverse=True)
    u = (rank + 0.5) / (rank.max() + 1)
    return np.cos(np.pi * np.outer(u, np.arange(first, first + count)))


def orthonormal(columns: FloatArray) -> FloatArray:
    """An orthonormal basis of the columns' span, rank found by pivoting; (n, rank)."""
    from scipy.linalg.lapack import dgeqp3, dorgqr

    length = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    kept = length > 1e-12 * max(length.max(initial=0.0), 1e-300)
    if not kept.any():
        return np.zeros((len(columns), 0))
    # one copy, laid out by columns so that the factorisation can overwrite it
    columns = np.array(columns[:, kept], order="F", copy=None)
    np.divide(columns, [float(np.sqrt(np.sum(x**2))) for x in columns.T], out=columns)
    # scipy's `qr` spends as long on checks as on a few columns
    room = 64 * (columns.shape[1] + 3)
    factored, _, scales, _, _ = dgeqp3(columns, lwork=room, overwrite_a=True)
    diagonal = np.abs(np.diag(factored))
    rank = int((diagonal > SPANNED * diagonal[0]).sum())
    q, _, _ = dorgqr(factored[:, : len(scales)], scales, lwork=room, overwrite_a=True)
    return np.asarray(q[:, :rank], dtype=np.float64)


def left_singular(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Left singular vectors (n, r) and singular values (r,) of the columns, by QR iteration where
    divide and conquer does not converge.
    """
    from scipy.linalg import svd

    try:
        u, length, _ = np.linalg.svd(columns, full_matrices=False)
    except np.linalg.LinAlgError:
        u, length, _ = svd(columns, full_matrices=False, lapack_driver="gesvd")
    return u, length


def framed(basis: FloatArray) -> FloatArray:
    """The orthonormal basis (n, d) of the same span that a fixed set of directions picks.

    Where columns tie, rounding decides which basis a factorisation gives. Draws in its coordinates
    must not depend on that.
    """
    q, r = np.linalg.qr(basis.T @ np.random.default_rng(0).standard_normal(basis.shape))
    result: FloatArray = basis @ (q * np.where(np.diag(r) < 0, -1.0, 1.0))
    return result
