"""Covariance with memory in run order, factored and applied in time linear in the trials.

``K = diag(variance) + sum_k A_k M_k A_k``: process k has an amplitude at every trial. It keeps the
part `memory[i, k]` of itself from trial i - 1 to trial i, 0 where it restarts. Two trials share the
product of the memories between them. An Ornstein-Uhlenbeck drift keeps exp(-dt / tau); the common
error of a visit is kept whole within it. Such a matrix has a Cholesky factor ``L = 1 + tril(A W')``
of the same kind, found in one pass. Source: Foreman-Mackey 2018, Res. Notes AAS 2, 31 (celerite's
recursions), with memories of any kind.

All arrays are in run order, C-contiguous: `variance` (n,), `amplitude` and `memory` (n, J),
right-hand sides (n, m).
"""

from __future__ import annotations

from typing import Any

import numpy as np


def _factor(variance: Any, amplitude: Any, memory: Any) -> Any:
    """D (n,) and W (n, J) of ``K = L diag(D) L'``."""
    n, count = amplitude.shape
    d, w = np.empty_like(variance), np.empty_like(amplitude)
    state = np.zeros((count, count), dtype=amplitude.dtype)
    along = np.zeros(count, dtype=amplitude.dtype)
    for i in range(n):
        total = variance[i]
        for j in range(count):
            total += amplitude[i, j] * amplitude[i, j]
        if i:
            for j in range(count):
                for k in range(j + 1):
                    value = (
                        memory[i, j]
                        * memory[i, k]
                        * (state[j, k] + d[i - 1] * w[i - 1, j] * w[i - 1, k])
                    )
                    state[j, k] = value
                    state[k, j] = value
        for j in range(count):
            value = along[j] * 0
            for k in range(count):
                value += state[j, k] * amplitude[i, k]
            along[j] = value
            total -= amplitude[i, j] * value
        d[i] = total
        for j in range(count):
            w[i, j] = (amplitude[i, j] - along[j]) / total
    return d, w


def _forward(d: Any, w: Any, amplitude: Any, memory: Any, x: Any) -> Any:
    """``D^-1/2 L^-1 x``."""
    n, count = amplitude.shape
    m = x.shape[1]
    z, state = np.empty_like(x), np.zeros((count, m))
    for i in range(n):
        for c in range(m):
            z[i, c] = x[i, c]
        for j in range(count):
            keep, pull = memory[i, j], amplitude[i, j]
            gone = w[i - 1, j] if i else 0.0
            if keep == 0.0:
                for c in range(m):
                    state[j, c] = 0.0
            else:
                for c in range(m):
                    state[j, c] = keep * (state[j, c] + gone * z[i - 1, c])
                    z[i, c] -= pull * state[j, c]
    for i in range(n):
        root = 1 / np.sqrt(d[i])
        for c in range(m):
            z[i, c] *= root
    return z


def _backward(d: Any, w: Any, amplitude: Any, memory: Any, x: Any) -> Any:
    """``L'^-1 D^-1/2 x``."""
    n, count = amplitude.shape
    m = x.shape[1]
    z, state = np.empty_like(x), np.zeros((count, m))
    for back in range(n):
        i = n - 1 - back
        root = 1 / np.sqrt(d[i])
        for c in range(m):
            z[i, c] = root * x[i, c]
        if i == n - 1:
            continue
        for j in range(count):
            keep, pull, gone = memory[i + 1, j], w[i, j], amplitude[i + 1, j]
            if keep == 0.0:
                for c in range(m):
                    state[j, c] = 0.0
            else:
                for c in range(m):
                    state[j, c] = keep * (state[j, c] + gone * z[i + 1, c])
                    z[i, c] -= pull * state[j, c]
    return z


def _product(amplitude: Any, memory: Any, x: Any) -> Any:
    """``sum_k A_k M_k A_k x``."""
    n, count = amplitude.shape
    m = x.shape[1]
    y, past, future = np.zeros_like(x), np.zeros((count, m)), np.zeros((count, m))
    for i in range(n):
        for j in range(count):
            keep, here = memory[i, j], amplitude[i, j]
            for c in range(m):
                past[j, c] = keep * past[j, c] + here * x[i, c]
                y[i, c] += here * past[j, c]
    for back in range(n - 1):
        i = n - 2 - back
        for j in range(count):
            keep, gone, here = memory[i + 1, j], amplitude[i + 1, j], amplitude[i, j]
            for c in range(m):
                future[j, c] = keep * (future[j, c] + gone * x[i + 1, c])
                y[i, c] += here * future[j, c]
    return y


def _squares(amplitude: Any, memory: Any, x: Any) -> Any:
    """The trace of ``x' A_k M_k A_k x`` for each process k, (J,)."""
    n, count = amplitude.shape
    m = x.shape[1]
    past, total = np.zeros((count, m)), np.zeros((count, m))
    for i in range(n):
        for j in range(count):
            keep, here = memory[i, j], amplitude[i, j]
            for c in range(m):
                before, mine = keep * past[j, c], here * x[i, c]
                total[j, c] += mine * (2 * before + mine)
                past[j, c] = before + mine
    return total.sum(axis=1)


def _log_det_slopes(d: Any, w: Any, amplitude: Any, memory: Any) -> Any:
    """Derivatives of ``log det K`` by each variance, (n,), and by the log amplitude of each
    process, (J,).

    The first are the inverse's diagonal. The factor's recursion is differentiated from its end.
    """
    n, count = amplitude.shape
    state = np.zeros((n, count, count))
    for i in range(1, n):
        for j in range(count):
            for k in range(count):
                state[i, j, k] = (
                    memory[i, j]
                    * memory[i, k]
                    * (state[i - 1, j, k] + d[i - 1] * w[i - 1, j] * w[i - 1, k])
                )
    by_variance, by_amplitude = np.empty(n), np.zeros(count)
    by_state, by_w = np.zeros((count, count)), np.zeros(count)
    for back in range(n):
        i = n - 1 - back
        by_d = 1 / d[i]
        # by_state is that of the trial after; what it was made of has the same memories
        for j in range(count):
            by_w[j] = 0.0
            for k in range(count):
                value = 0.0
                if i < n - 1:
                    value = memory[i + 1, j] * memory[i + 1, k] * by_state[j, k]
                by_state[j, k] = value
                by_w[j] += 2 * d[i] * value * w[i, k]
            by_d += 0.5 * by_w[j] * w[i, j] / d[i]
        for j in range(count):
            by_d -= by_w[j] * w[i, j] / d[i]
        by_variance[i] = by_d
        for j in range(count):
            value = by_w[j] / d[i] + 2 * by_d * amplitude[i, j]
            for k in range(count):
                value -= state[i, j, k] * (by_w[k] / d[i] + 2 * by_d * amplitude[i, k])
            by_amplitude[j] += value * amplitude[i, j]
        for j in range(count):
            for k in range(count):
                by_state[j, k] -= (
                    0.5 * (by_w[j] * amplitude[i, k] + amplitude[i, j] * by_w[k]) / d[i]
                    + by_d * amplitude[i, j] * amplitude[i, k]
                )
    return by_variance, by_amplitude


def _near_inverse(d: Any, w: Any, amplitude: Any, memory: Any, reach: Any) -> Any:
    """The inverse's entries [i, i + k] as [i, k], for k up to `reach[i]`; nan beyond, (n, widest +
    1).
    """
    n, count = amplitude.shape
    widest = 0
    for i in range(n):
        widest = max(widest, reach[i])
    inverse = np.full((n, widest + 1), np.nan)
    # what the trials after i make of a unit of each process that reaches them: their sum of squares
    after, step, half = (
        np.zeros((n + 1, count, count)),
        np.zeros((count, count)),
        np.zeros((count, count)),
    )
    for back in range(n):
        i = n - 1 - back
        for j in range(count):
            for k in range(count):
                step[j, k] = -w[i, j] * amplitude[i, k] + (1.0 if j == k else 0.0)
        # after[i] = u u' / d + step' F after[i + 1] F step, F the memories from i to i + 1
        for j in range(count):
            for k in range(count):
                total = 0.0
                if i < n - 1:
                    for a in range(count):
                        total += after[i + 1, j, a] * memory[i + 1, a] * step[a, k]
                    total *= memory[i + 1, j]
                half[j, k] = total
        for j in range(count):
            for k in range(count):
                total = amplitude[i, j] * amplitude[i, k] / d[i]
                for a in range(count):
                    total += step[a, j] * half[a, k]
                after[i, j, k] = total
    left, right = np.zeros(count), np.zeros(count)
    for i in range(n):
        total = 1 / d[i]
        for j in range(count):
            left[j] = memory[i + 1, j] * w[i, j] if i < n - 1 else 0.0
        if i < n - 1:
            for j in range(count):
                for k in range(count):
                    total += left[j] * after[i + 1, j, k] * left[k]
        inverse[i, 0] = total
        for k in range(1, reach[i] + 1):
            at = i + k
            # L^-1 e_i at trial `at` is -A.state; e_at begins there
            value = 0.0
            for j in range(count):
                value -= amplitude[at, j] * left[j]
            total = value / d[at]
            if at < n - 1:
                for j in range(count):
                    left[j] = memory[at + 1, j] * (left[j] + w[at, j] * value)
                    right[j] = memory[at + 1, j] * w[at, j]
                for j in range(count):
                    for a in range(count):
                        total += left[j] * after[at + 1, j, a] * right[a]
            inverse[i, k] = total
    return inverse


def __getattr__(name: str) -> Any:
    """Compiled version of a function above, by its name without the underscore, made on demand."""
    if (plain := globals().get(f"_{name}")) is None:
        raise AttributeError(name)
    from nearlift.compiler import compiled

    return globals().setdefault(name, compiled(plain))
